// From image to wheels, one agent after another, float32: with floor.cpp the floor of pixels.py.
#include <algorithm>
#include <cstdint>
#include <cstring>
const int H = 39, W = 52, HUES = 24, MAP = HUES * W;
struct Fields { float seen[MAP], central[MAP], heading[W]; };
// Kernels as the library builds them: symmetric matrices, one for each axis.
struct Optics {
  const float *blur, *seen_hue, *seen_column, *central_hue, *central_column, *heading;
  const float *hue_bias, *hue_rows, *center, *bearing;
  float seen_everywhere, gain, scan, softness, half_axle;
};

static inline float power(float x) {  // 2^x to 1e-6: vectorises, unlike expf
  const float whole = std::nearbyint(x), f = x - whole;
  const float rest = 1 + f * (.6931472f + f * (.2402265f + f * (.0555041f + f * (.0096181f +
                     f * .0013333f))));
  const int32_t bits = ((int32_t)whole + 127) << 23;
  float scale;
  std::memcpy(&scale, &bits, 4);
  return rest * scale;
}
static inline float rate(float u) {
  return 1 / (1 + power(std::min(std::max(-5.7707802f * u, -120.f), 120.f)));
}

// out[R][N] = a[R][K] b[K][N]
template <int R, int K, int N> static void multiply(const float* a, const float* b, float* out) {
  for (int r = 0; r < R; r++) {
    float row[N] = {};
    for (int k = 0; k < K; k++)
      for (int j = 0; j < N; j++) row[j] += a[r * K + k] * b[k * N + j];
    std::memcpy(out + r * N, row, sizeof row);
  }
}

static void percept(const uint8_t* image, const float* blur, float* out) {
  uint8_t count[HUES + 1][W] = {};
  for (int y = 0; y < H; y++) {
    float red[W], green[W], blue[W];
    uint8_t bin[W];
    for (int x = 0; x < W; x++) {
      const uint8_t* pixel = image + 3 * (y * W + x);
      red[x] = pixel[0]; green[x] = pixel[1]; blue[x] = pixel[2];
    }
    for (int x = 0; x < W; x++) {
      const float r = red[x], g = green[x], b = blue[x];
      const float value = std::max(std::max(r, g), b), chroma = value - std::min(std::min(r, g), b);
      const float other = value == g ? b - r + 2 * chroma : r - g + 4 * chroma;
      const float turned = HUES * (value == r ? g - b : other);
      float hue = std::nearbyint(turned / std::max(6 * chroma, 1.f));
      hue -= HUES * std::floor(hue / HUES);
      const bool colored = (chroma / std::max(value, 1.f) >= 90.f / 255) & (value >= 40);
      bin[x] = colored ? hue : HUES;
    }
    for (int x = 0; x < W; x++) count[bin[x]][x]++;
  }
  float salience[MAP];
  for (int k = 0; k < MAP; k++) salience[k] = std::min(4.f / H * (&count[0][0])[k], 1.f);
  multiply<HUES, W, W>(salience, blur, out);
}

static void one_look(Agent& agent, Fields& field, const uint8_t* image, const float* reward,
                     const float* noise, const float* base, const Optics& o, float* wheels) {
  float seen[MAP], central[MAP], heading[W], drive[MAP], rows[MAP], spread[MAP], match[4] = {};
  float bias[HUES] = {}, total = 0, top[W] = {};
  for (int k = 0; k < MAP; k++) { seen[k] = rate(field.seen[k]); central[k] = rate(field.central[k]); }
  for (int x = 0; x < W; x++) heading[x] = rate(field.heading[x]);
  for (int h = 0; h < HUES; h++) {
    float held = 0;
    for (int x = 0; x < W; x++) { held += central[h * W + x]; total += seen[h * W + x]; }
    for (int i = 0; i < 4; i++) {
      match[i] += o.hue_rows[i * HUES + h] * held / 1.6f;
      bias[h] += 2.5f * f(agent.ui[i]) * o.hue_bias[i * HUES + h];
    }
    for (int x = 0; x < W; x++) top[x] = std::max(top[x], seen[h * W + x]);
  }
  for (float& m : match) m = std::min(m, 1.f);
  percept(image, o.blur, drive);
  multiply<HUES, W, W>(seen, o.seen_column, rows);
  multiply<HUES, HUES, W>(o.seen_hue, rows, spread);
  for (int k = 0; k < MAP; k++) {
    const float target = 4 * drive[k] + bias[k / W] + spread[k] + o.seen_everywhere * total - 5;
    field.seen[k] += .3125f * (target - field.seen[k]);
  }
  multiply<HUES, W, W>(central, o.central_column, rows);
  multiply<HUES, HUES, W>(o.central_hue, rows, spread);
  for (int k = 0; k < MAP; k++) {
    const float target = 4 * seen[k] + bias[k / W] * o.center[k % W] + spread[k] - 5;
    field.central[k] += .3125f * (target - field.central[k]);
  }
  float pull[W];
  multiply<1, W, W>(heading, o.heading, pull);
  for (int x = 0; x < W; x++)
    field.heading[x] += .3125f * (8 * top[x] + pull[x] - 5 - field.heading[x]);
  one_step(&agent, match, reward, noise, 1, base);
  float on = 0, sum = 0, aim = 0;
  for (int i = 0; i < 4; i++) on = std::max(on, f(agent.ui[i]));
  for (int x = 0; x < W; x++) { const float y = rate(field.heading[x]); sum += y; aim += y * o.bearing[x]; }
  const float turn = (o.gain * aim + o.softness * o.scan) / (o.softness + sum) * (on > .5f);
  wheels[0] = -turn * o.half_axle; wheels[1] = turn * o.half_axle;
}

// A portion of steps: images[steps][batch][39][52][3], wheels[batch][2].
extern "C" void look(Agent* agents, Fields* fields, const uint8_t* images, const float* reward,
                     const float* noise, int batch, const float* base, const Optics* optics,
                     float* wheels, int steps) {
  for (long t = 0; t < steps; t++)
    for (int b = 0; b < batch; b++)
      one_look(agents[b], fields[b], images + (batch * t + b) * 3 * H * W, reward + b,
               noise + 4 * b, base, *optics, wheels + 2 * b);
}
