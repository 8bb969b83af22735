// Draws what `Drawing.encode` describes: a canvas per panel, in rows beside Bokeh's widgets.
// Arguments: beat, drawn, pressed (sources), palette (colours as numbers), names (of keys).
if (window.dntorch) return
const BLUE = "#1f5fa8", GREEN = "#2a9d43", ORANGE = "#d97706", DIM = "#777"
const LEFT = 34, TOP = 20, BOTTOM = 18, SIDE = 230
const lut = new Uint32Array(256)
palette.forEach((c, k) => { lut[k] = (255 << 24) | ((c & 255) << 16) | (c & 0xff00) | (c >> 16) })
lut[255] = 0xffdddddd

document.body.style.cssText += "display:flex;align-items:flex-start;gap:16px;font:13px sans-serif"
const place = document.createElement("div")
place.id = "figures"
const status = document.createElement("div")
status.id = "status"
status.style.cssText = "min-height:20px;padding:6px 0"
place.append(status)
document.body.append(place)
let layout = "", canvases = []

function send(what) { pressed.data = {...what, n: [pressed.data.n[0] + 1]} }

function size(panel, row) {
  if (panel.kind === "lines") return [2 * SIDE, SIDE]
  const [rows, columns] = panel.shape, first = row.panels[0]
  if (panel.steps) return [SIDE, first.kind === "map" ? Math.max(110, size(first, row)[1]) : SIDE]
  const shrink = Math.min(SIDE / columns, 1.2 * SIDE / rows)
  return [Math.max(60, columns * shrink), Math.max(60, rows * shrink)]
}

function build(rows) {
  document.querySelectorAll("#figures .row").forEach((row) => row.remove())
  canvases = []
  for (const row of rows) {
    const line = document.createElement("div")
    line.className = "row"
    line.style.cssText = "display:flex;flex-wrap:wrap;align-items:flex-start;gap:12px;margin-bottom:8px"
    for (const panel of row.panels) {
      const canvas = document.createElement("canvas"), [width, height] = size(panel, row)
      canvas.width = LEFT + width + 46
      canvas.height = TOP + height + BOTTOM
      canvas.dataset.label = row.label
      canvas.dataset.title = panel.title
      Object.assign(canvas, {wide: width, high: height})
      if (panel.touch !== undefined) {
        canvas.style.cursor = "crosshair"
        canvas.addEventListener("click", (event) => touch(canvas, row.label, event))
      }
      line.append(canvas)
      canvases.push(canvas)
    }
    place.append(line)
  }
}

function touch(canvas, label, event) {
  const panel = canvas.panel, x = (event.offsetX - LEFT) / canvas.wide
  const y = (event.offsetY - TOP) / canvas.high
  if (x < 0 || x >= 1 || y < 0 || y >= 1) return
  const [rows, columns] = panel.shape || [1, panel.n]
  const site = [y * rows - 0.5, x * columns - 0.5]
  send({key: ["touch"], label: [label], position: [panel.touch ? site.slice(-panel.touch) : []]})
}

function number(x) { return String(+x.toPrecision(3)) }

function text(g, what, x, y, align = "left", color = DIM) {
  g.textAlign = align
  g.fillStyle = color
  g.fillText(what, x, y)
}

function frame(canvas, panel) {
  const g = canvas.getContext("2d")
  g.clearRect(0, 0, canvas.width, canvas.height)
  g.font = "bold 12px sans-serif"
  text(g, panel.title, LEFT, 13, "left", "#222")
  g.font = "10px sans-serif"
  return g
}

function ends(g, canvas, panel) {
  const [rows, columns] = panel.shape || [0, panel.n], base = TOP + canvas.high
  if (panel.letters) {
    const each = canvas.wide / columns, down = canvas.high / rows
    for (let k = 0; k < columns; k++) text(g, panel.letters[k], LEFT + (k + 0.4) * each, base + 12)
    if (rows !== columns) return
    for (let k = 0; k < rows; k++) text(g, panel.letters[k], LEFT - 4, TOP + (k + 0.6) * down, "right")
    return
  }
  const across = panel.steps && !panel.shape ? ["-" + columns, "now"] : ["0", columns - 1]
  text(g, across[0], LEFT, base + 12)
  text(g, across[1], LEFT + canvas.wide, base + 12, "right")
  if (!rows) return
  text(g, panel.steps ? "-" + rows : "0", LEFT - 4, TOP + 9, "right")
  text(g, panel.steps ? "now" : rows - 1, LEFT - 4, base, "right")
}

function drawMap(canvas, panel, bytes) {
  const [rows, columns] = panel.shape, g = frame(canvas, panel)
  if (!canvas.sites || canvas.sites.width !== columns || canvas.sites.height !== rows) {
    canvas.sites = new OffscreenCanvas(columns, rows)
  }
  const inner = canvas.sites.getContext("2d"), data = inner.createImageData(columns, rows)
  const colors = new Uint32Array(data.data.buffer)
  for (let k = 0; k < bytes.length; k++) colors[k] = lut[bytes[k]]
  inner.putImageData(data, 0, 0)
  g.imageSmoothingEnabled = false
  g.drawImage(canvas.sites, LEFT, TOP, canvas.wide, canvas.high)
  ends(g, canvas, panel)
  const right = LEFT + canvas.wide + 4, steps = Math.floor(canvas.high)
  for (let k = 0; k < steps; k += 2) {
    g.fillStyle = "#" + palette[Math.floor(254 * (1 - k / steps))].toString(16).padStart(6, "0")
    g.fillRect(right, TOP + k, 7, 2)
  }
  text(g, number(panel.values[1]), right + 10, TOP + 9)
  text(g, number(panel.values[0]), right + 10, TOP + canvas.high)
}

function drawLines(canvas, panel, floats) {
  const g = frame(canvas, panel), n = panel.n, wide = canvas.wide, high = canvas.high
  g.strokeStyle = "#ccc"
  g.strokeRect(LEFT, TOP, wide, high)
  ends(g, canvas, panel)
  const curve = (values, [low, bound], color) => {
    const x = (k) => LEFT + wide * (k + 0.5) / n
    const y = (v) => TOP + high * (1 - (v - low) / (bound - low))
    g.strokeStyle = color
    g.lineWidth = 2
    g.beginPath()
    let open = false
    values.forEach((v, k) => {
      if (Number.isNaN(v)) { open = false; return }
      if (open) g.lineTo(x(k), y(v)); else g.moveTo(x(k), y(v))
      open = true
    })
    g.stroke()
    g.fillStyle = color
    if (n <= 12) values.forEach((v, k) => g.fillRect(x(k) - 3, y(v) - 3, 6, 6))
    return y
  }
  const [low, bound] = panel.values
  curve(floats.subarray(2 * n, 3 * n), panel.values, ORANGE)
  curve(floats.subarray(n, 2 * n), panel.rates, GREEN)
  const y = curve(floats.subarray(0, n), panel.values, BLUE)
  g.lineWidth = 1
  if (low < 0 && bound > 0) {
    g.setLineDash([2, 3])
    g.strokeStyle = "#999"
    g.beginPath()
    g.moveTo(LEFT, y(0))
    g.lineTo(LEFT + wide, y(0))
    g.stroke()
    g.setLineDash([])
    text(g, "0", LEFT - 4, y(0) + 3, "right")
  }
  text(g, number(bound), LEFT - 4, TOP + 9, "right", BLUE)
  text(g, number(low), LEFT - 4, TOP + high, "right", BLUE)
  text(g, number(panel.rates[1]), LEFT + wide + 4, TOP + 9, "left", GREEN)
  text(g, number(panel.rates[0]), LEFT + wide + 4, TOP + high, "left", GREEN)
  text(g, "activation", LEFT + wide - 110, 13, "right", BLUE)
  text(g, "output", LEFT + wide - 60, 13, "right", GREEN)
  text(g, "input", LEFT + wide - 20, 13, "right", ORANGE)
}

function drawImage(canvas, panel, bytes) {
  const [rows, columns] = panel.shape, g = frame(canvas, panel)
  const sites = new OffscreenCanvas(columns, rows), inner = sites.getContext("2d")
  const data = inner.createImageData(columns, rows)
  for (let k = 0, at = 0; k < bytes.length; k += 3, at += 4) {
    data.data[at] = bytes[k]
    data.data[at + 1] = bytes[k + 1]
    data.data[at + 2] = bytes[k + 2]
    data.data[at + 3] = 255
  }
  inner.putImageData(data, 0, 0)
  g.imageSmoothingEnabled = false
  g.drawImage(sites, LEFT, TOP, canvas.wide, canvas.high)
}

function draw() {
  const described = JSON.parse(beat.data.described[0]), bytes = beat.data.bytes[0]
  const pace = described.playing && described.pace ? `, ${number(described.pace)} s per second` : ""
  status.textContent = `${described.time.toFixed(3)} s${pace}  ${described.note}`
  const forms = described.rows.map((row) => [row.label, row.panels.map((x) => [x.title, x.shape, x.n])])
  if (JSON.stringify(forms) !== layout) {
    layout = JSON.stringify(forms)
    build(described.rows)
  }
  let at = 0, k = 0
  const take = (count) => bytes.slice(at, at += count)
  for (const row of described.rows) {
    for (const panel of row.panels) {
      const canvas = canvases[k++]
      canvas.panel = panel
      if (panel.kind === "lines") {
        drawLines(canvas, panel, new Float32Array(new Uint8Array(take(12 * panel.n)).buffer))
      } else {
        const sites = panel.shape[0] * panel.shape[1], image = panel.kind === "image"
        ;(image ? drawImage : drawMap)(canvas, panel, take(image ? 3 * sites : sites))
      }
    }
  }
  window.dntorch.pictures += 1
  const n = beat.data.n[0]
  requestAnimationFrame(() => { drawn.data = {n: [n]} })
}

// A button that was clicked lets go of the keyboard, so that a space plays and pauses.
document.addEventListener("click", (event) => {
  const button = event.composedPath().find((x) => x.matches && x.matches("button"))
  if (button && event.detail) button.blur()
})
document.addEventListener("keydown", (event) => {
  const inside = (what) => event.composedPath().some((x) => x.matches && x.matches(what))
  if (!names.includes(event.key) || event.repeat || inside("input, select, textarea")) return
  if (event.key === " ") {
    if (inside("button, .noUi-handle")) return
    event.preventDefault()
  }
  send({key: [event.key], label: [""], position: [[]]})
})
window.dntorch = {draw, pictures: 0}
