#!/usr/bin/env python3
"""Decodes the frames of a unit test with cantools, for the values that the test compares.

    cargo test --release -p lookout-tools --lib print_the_frames -- --nocapture |
        tests/can/decode_values.py config/can/lookout.dbc > tools/src/can_out/cantools_values.txt

Needs the Python package cantools. Run it after a change of the layout (tools/src/can_out/layout.rs).
"""
import sys

import cantools

database = cantools.database.load_file(sys.argv[1], strict=True)
for line in sys.stdin:
    # The first line follows the name of the test.
    words = line[line.find("frame "):].split()
    if len(words) != 4 or words[0] != "frame":
        continue
    cycle, identifier, data = words[1], words[2], bytes.fromhex(words[3])
    message = database.get_message_by_frame_id(int(identifier, 16))
    named = message.decode(data)
    numbers = message.decode(data, decode_choices=False)
    absent = {name for name, value in named.items() if str(value) == "not available"}
    texts = [f"{name}={'-' if name in absent else f'{value:.10g}'}" for name, value in numbers.items()]
    print(cycle, identifier, data.hex(), *texts)
