#!/usr/bin/env python3
"""Decodes the frames of a unit test with cantools, for the values that the test compares.

    cargo test --release -p lookout-tools --lib print_the_frames -- --nocapture |
        tests/can/decode_values.py config/can/lookout.dbc > tools/src/can_out/cantools_values.in

Needs the Python package cantools. Run it after a change of the layout (tools/src/can_out/layout.rs).
"""
import sys

import cantools

database = cantools.database.load_file(sys.argv[1], strict=True)
print("[")
for line in sys.stdin:
    # The first line follows the name of the test.
    words = line[line.find("frame "):].split()
    if len(words) != 4 or words[0] != "frame":
        continue
    cycle, identifier, data = int(words[1]), int(words[2], 16), bytes.fromhex(words[3])
    message = database.get_message_by_frame_id(identifier)
    named = message.decode(data)
    numbers = message.decode(data, decode_choices=False)
    bytes_ = ", ".join(f"0x{byte:02x}" for byte in data)
    print(f"    ({cycle}, 0x{identifier:x}, [{bytes_}], &[")
    for name, value in numbers.items():
        is_absent = str(named[name]) == "not available"
        text = "None" if is_absent else f"Some({round(float(value), 6)!r})"
        print(f'        ("{name}", {text}),')
    print("    ]),")
print("]")
