#!/usr/bin/env python3
"""Compares recorded frames of CAN out with the obstacles.jsonl of the run that they were sent in.

    check_out.py FRAMES.log obstacles.jsonl lookout.dbc

FRAMES.log is what `candump -L` wrote. Checks checksum and alive counter of every frame, that each cycle is whole, and
that the values of each cycle that has a result are those of its line of obstacles.jsonl, to half a step of each signal; of what
a cycle holds, that line lacks the age, whether an object moves, and the state of the daemon.
Needs the Python package cantools, which decodes the frames. Prints what was compared.
"""
import json
import sys

import cantools

LEVELS = {"off": "off", "clear": "clear", "standby": "clear", "warning": "warning", "alarm": "alarm"}
CLASSES = ("obstacle", "vehicle", "pedestrian", "rider")
ABSENT = "not available"
FIRST_DATA_ID = 0x4C00


def checksum(data, data_id):
    """AUTOSAR E2E profile 1A, bit by bit."""
    crc = 0
    for byte in bytes([data_id & 0xFF, data_id >> 8]) + data[1:]:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc


def frames(path):
    for line in open(path):
        identifier, data = line.split()[2].split("#")
        yield int(identifier, 16), bytes.fromhex(data)


class Check:
    def __init__(self, database):
        self.database = database
        self.base = min(message.frame_id for message in database.messages)
        self.steps = {s.name: s for m in database.messages for s in m.signals}
        self.values = 0

    def equal(self, name, got, expected, rounding=1e-3):
        """Asserts that a signal has a value: to half a step, or the end of its range, or absent. The line of obstacles.jsonl
        is itself rounded by up to `rounding`."""
        self.values += 1
        signal = self.steps[name]
        if expected is None:
            assert str(got) == ABSENT, f"{name} is {got}, not absent"
        elif isinstance(expected, str):
            assert str(got) == expected, f"{name} is {got}, not {expected}"
        else:
            within = min(max(expected, signal.minimum), signal.maximum)
            slack = signal.scale / 2 + rounding
            assert str(got) != ABSENT and abs(float(got) - within) <= slack, f"{name} is {got}, not {expected}"

    def shape(self, cycle, name, obstacle):
        get = lambda signal: cycle[f"{name}Shape_{signal}"]
        if obstacle is None:
            self.equal(f"{name}_Distance", cycle[f"{name}_Distance"], None)
            self.equal(f"{name}Shape_Existence", get("Existence"), "none")
            return
        ttc = obstacle["time_to_collision_s"]
        for signal, value in (
            ("Distance", obstacle["distance_m"]),
            ("Lateral", obstacle["lateral_m"]),
            ("ClosingSpeed", obstacle["closing_m_s"]),
            ("LateralSpeed", obstacle["across_m_s"]),
            ("TimeToCollision", float("inf") if ttc is None else ttc),
        ):
            self.equal(f"{name}_{signal}", cycle[f"{name}_{signal}"], value)
        seen = "predicted" if obstacle["missed"] else "measured"
        for signal, value in (
            ("Track", obstacle["track"] & 0xFFFF),
            ("Width", obstacle["width_m"]),
            ("Height", obstacle["height_m"]),
            ("DistanceSigma", obstacle["distance_sigma_m"]),
            ("Class", obstacle["class"] if obstacle["class"] in CLASSES else "other"),
            ("InPath", "yes" if obstacle["in_path"] else "no"),
            ("Existence", seen if obstacle["confirmed"] else "tentative"),
        ):
            self.equal(f"{name}Shape_{signal}", get(signal), value)

    def cycle(self, cycle, record):
        alarm, motion = record["alarm"], record["motion"]
        self.equal("Status_AlarmLevel", cycle["Status_AlarmLevel"], LEVELS[alarm["level"]])
        self.equal("Status_AlarmRule", cycle["Status_AlarmRule"], alarm["rule"] or "none")
        self.equal("Status_RoadSeen", cycle["Status_RoadSeen"], "yes" if record["road"] else "no")
        is_off = alarm["level"] == "off"
        faults = [s for s in cycle if s.startswith("Status_Fault") and str(cycle[s]) == "yes"]
        assert bool(faults) == is_off, f"{faults} with the level {alarm['level']}"
        for signal, key in (
            ("Speed", "speed_m_s"),
            ("YawRate", "yaw_rate_rad_s"),
            ("SpeedSigma", "speed_sigma_m_s"),
            ("YawRateSigma", "yaw_rate_sigma_rad_s"),
        ):
            self.equal(f"Own_{signal}", cycle[f"Own_{signal}"], motion[key])
        self.equal("Own_Known", cycle["Own_Known"], "yes" if motion["known"] else "no")
        for signal in ("Standstill", "Disagree"):
            self.equal(f"Own_{signal}", cycle[f"Own_{signal}"], "yes" if motion[signal.lower()] else "no")
        self.equal("Status_Source", cycle["Status_Source"], "scene")
        path = record["path"]
        self.equal("Path_Known", cycle["Path_Known"], "yes" if path["known"] else "no")
        self.equal("Path_Curvature", cycle["Path_Curvature"], path["curvature_per_m"], 6e-5)
        self.equal("Path_CurvatureSigma", cycle["Path_CurvatureSigma"], path["curvature_sigma_per_m"], 6e-5)
        (left_m, left_front_m), (right_m, right_front_m) = path["left_m"][0], path["right_m"][0]
        front_m = (left_front_m + right_front_m) / 2
        self.equal("Path_HalfWidth", cycle["Path_HalfWidth"], (right_m - left_m) / 2)
        in_path = sum(o["in_path"] and o["confirmed"] for o in record["obstacles"])
        self.equal("Path_ObjectsInPath", cycle["Path_ObjectsInPath"], in_path)
        self.equal("Path_Objects", cycle["Path_Objects"], len(record["obstacles"]))
        nearest_m = alarm["nearest_m"]
        if is_off:
            self.equal("Path_FreeDistance", cycle["Path_FreeDistance"], None)
        elif nearest_m is None:
            self.equal("Path_FreeDistance", cycle["Path_FreeDistance"], float("inf"))
        else:
            self.equal("Path_FreeDistance", cycle["Path_FreeDistance"], max(nearest_m - front_m, 0.0))
        if is_off or nearest_m is None:
            self.equal("Nearest_Distance", cycle["Nearest_Distance"], None)
        else:
            self.equal("Nearest_Distance", cycle["Nearest_Distance"], nearest_m)
            tracks = {o["track"] & 0xFFFF: o for o in record["obstacles"]}
            self.shape(cycle, "Nearest", tracks[cycle["NearestShape_Track"]])
        nearest_first = sorted(record["obstacles"], key=lambda o: (o["distance_m"], o["track"]))
        for place in range(8):
            known = nearest_first[place] if place < len(nearest_first) else None
            self.shape(cycle, f"Object{place + 1}", known)


def main():
    frames_path, lines_path, dbc_path = sys.argv[1:]
    check = Check(cantools.database.load_file(dbc_path, strict=True))
    # Frame numbers are the low 8 bits: the runs are shorter.
    records = {record["sequence"]: record for record in map(json.loads, open(lines_path))}
    assert len(records) <= 256, "too many frames for their numbers"
    size = len(check.database.messages)
    cycle, counters, found, empty, cycles, total = {}, [], set(), 0, 0, 0
    for identifier, data in frames(frames_path):
        if not cycle and identifier != check.base:
            # The recording begins in the middle of a cycle.
            assert cycles == 0, f"{identifier:#x} without its status frame"
            continue
        total += 1
        assert data[0] == checksum(data, FIRST_DATA_ID + identifier - check.base), f"checksum of {identifier:#x}"
        counters.append(data[1] & 0xF)
        cycle.update(check.database.decode_message(identifier, data))
        if len(counters) < size:
            continue
        assert len(set(counters)) == 1, f"counters of one cycle: {counters}"
        if cycles:
            assert counters[0] == (last + 1) % 15, f"counter {counters[0]} after {last}"
        last = counters[0]
        cycles += 1
        if str(cycle["Path_Known"]) == ABSENT:
            empty += 1
            assert str(cycle["Status_AlarmLevel"]) == "off", cycle
            for name in ("Nearest_Distance", "Own_Known", "Object1_Distance", "Object1Shape_Existence"):
                assert str(cycle[name]) == ABSENT, f"{name} without a result"
        else:
            number = cycle["Status_FrameNumber"]
            assert number in records, f"frame {number} is not in {lines_path}"
            try:
                check.cycle(cycle, records[number])
            except AssertionError as error:
                raise AssertionError(f"frame {number}: {error}") from None
            found.add(number)
        cycle, counters = {}, []
    print(
        f"{total} frames in {cycles} cycles: checksums and counters are right; {cycles - empty} cycles have the values of "
        f"{len(found)} of {len(records)} frames of obstacles.jsonl ({check.values} values), {empty} have none"
    )
    assert len(found) * 2 >= len(records), "less than half of the frames were sent"


main()
