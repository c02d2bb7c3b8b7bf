#!/usr/bin/env python3
"""Frames of a recording as a camera's driver delivers them: for tests/board/cameras.sh.

    tests/board/frames.py RECORDING.mcap OUT

RECORDING is of `lookout record` or `lookout replay --record`, with raw images. Writes the first pair of it into OUT:
left.GREY, right.GREY, left.YUYV, ... and size ("640x480"). Needs nothing but Python.
"""

import pathlib
import struct
import sys

CHANNEL, MESSAGE, CHUNK = 0x04, 0x05, 0x06


def records(data):
    """Opcode and content of each record."""
    at = 0
    while at + 9 <= len(data):
        code, length = struct.unpack_from("<BQ", data, at)
        yield code, data[at + 9 : at + 9 + length]
        at += 9 + length


def text(data, at):
    """A string with its length before it, and where it ends."""
    (length,) = struct.unpack_from("<I", data, at)
    return data[at + 4 : at + 4 + length].decode(), at + 4 + length


def varint(data, at):
    value, shift = 0, 0
    while True:
        byte = data[at]
        value, shift, at = value | (byte & 127) << shift, shift + 7, at + 1
        if byte < 128:
            return value, at


def fields(data):
    """Number and value of each field of a message of Protocol Buffers."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        wire = key & 7
        if wire == 0:
            value, at = varint(data, at)
        elif wire == 2:
            length, at = varint(data, at)
            value, at = data[at : at + length], at + length
        else:
            size = {1: 8, 5: 4}[wire]
            value, at = data[at : at + size], at + size
        yield key >> 3, value


def images(path):
    """Width, height and pixels of the first image of each topic."""
    magic = 8
    names, found = {}, {}

    def walk(data):
        for code, content in records(data):
            if code == CHUNK:
                compression, at = text(content, 28)
                if compression:
                    sys.exit(f"{path}: its chunks are compressed ({compression}): record it with lookout record --raw")
                walk(content[at + 8 :])
            elif code == CHANNEL:
                (number,) = struct.unpack_from("<H", content)
                names[number], _ = text(content, 4)
            elif code == MESSAGE:
                (number,) = struct.unpack_from("<H", content)
                topic = names.get(number, "")
                if topic.endswith("/image") and topic not in found:
                    # foxglove.RawImage: timestamp, width, height, encoding, step, data, frame_id
                    by_number = dict(fields(content[22:]))
                    width, height = (struct.unpack("<I", by_number[i])[0] for i in (2, 3))
                    found[topic] = (width, height, by_number[6])

    walk(path.read_bytes()[magic:-magic])
    return found


def frame(pixels, name):
    """Grey pixels in a pixel format."""
    colourless = bytes([128])
    if name == "GREY":
        return pixels
    if name in ("YUYV", "UYVY"):
        out = bytearray(colourless * (2 * len(pixels)))
        out[0 if name == "YUYV" else 1 :: 2] = pixels
        return bytes(out)
    return pixels + colourless * (len(pixels) // 2)  # NV12, YU12


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    out = pathlib.Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    found = images(pathlib.Path(sys.argv[1]))
    for side in ("left", "right"):
        width, height, pixels = found[f"/{side}/image"]
        for name in ("GREY", "YUYV", "UYVY", "NV12", "YU12"):
            (out / f"{side}.{name}").write_bytes(frame(pixels, name))
        (out / "size").write_text(f"{width}x{height}\n")


if __name__ == "__main__":
    main()
