"""A client of the e-puck2 over Wi-Fi, written from the protocol tables alone.

Imports nothing of the library. Prints one line of JSON for what it saw and did:
``python third_party_client.py HOST PORT [--hang]``; with ``--hang`` it drives on until killed.
"""

import json
import socket
import struct
import sys
import time


def exactly(link, size):
    data = b""
    while len(data) < size:
        more = link.recv(size - len(data))
        if not more:
            raise SystemExit("the robot closed the link")
        data += more
    return data


def command(left, right, request=3):
    return struct.pack("<BBBhhB12sB", 0x80, request, 0, left, right, 0, bytes(12), 0)


def frame(link):
    """One image (38400 bytes) and one set of sensors (104 bytes), in whatever order."""
    image = sensors = None
    while image is None or sensors is None:
        kind = exactly(link, 1)[0]
        if kind == 1:
            image = exactly(link, 38400)
        elif kind == 2:
            sensors = exactly(link, 104)
        elif kind != 3:
            raise SystemExit(f"unknown header {kind}")
    return image, sensors


def steps(sensors):
    return struct.unpack_from("<hh", sensors, 79)


def colors(image):
    """Pixels by their strongest part, where it is far above the others."""
    count = {"red": 0, "green": 0, "blue": 0, "yellow": 0}
    for at in range(0, len(image), 2):
        r = image[at] & 0xF8
        g = (image[at] & 7) << 5 | (image[at + 1] & 0xE0) >> 3
        b = (image[at + 1] & 0x1F) << 3
        if max(r, g, b) - min(r, g, b) < 80:
            continue
        if r > 100 and g > 100:
            count["yellow"] += 1
        else:
            count[max(("red", r), ("green", g), ("blue", b), key=lambda part: part[1])[0]] += 1
    return count


def main():
    link = socket.create_connection((sys.argv[1], int(sys.argv[2])), 10)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    link.sendall(command(0, 0))
    image, sensors = frame(link)
    start, seen = steps(sensors), colors(image)
    if "--hang" in sys.argv:
        link.sendall(command(-80, 80))
        print("driving", flush=True)
        while True:
            frame(link)
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        link.sendall(command(-100, 100))
        image, sensors = frame(link)
    for name, pixels in colors(image).items():
        seen[name] += pixels
    turned = [b - a for a, b in zip(start, steps(sensors))]
    link.sendall(command(0, 0))
    still, last = sensors, None
    for _ in range(100):  # frames that are on their way come first
        _, last = frame(link)
        if steps(last) == steps(still):
            break
        still = last
    result = {"turned": turned, "rest": [b - a for a, b in zip(steps(still), steps(last))]}
    print(json.dumps({**result, "seen": seen, "proximity": struct.unpack_from("<8H", last, 37)}))
    link.sendall(command(0, 0, 0))
    link.close()


if __name__ == "__main__":
    main()
