#!/usr/bin/env python3
"""Measures the tables of the documentation again.

A table stands between two comments in a page of docs/ or in README.md:

    <!-- table: NAME -->
    …
    <!-- end of table -->

Each has the commit, date and machine it was measured with, and the commands. Needs Python 3.9, the program (`cargo build
--release`) and, for some tables, the recorded data, which are no part of the project. A table whose data are absent stays
as it is, with a printed reason.
"""

import argparse
import datetime
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"<!-- table: (?P<name>[a-z-]+) -->\n(?P<body>.*?)<!-- end of table -->\n", re.DOTALL)
MEASURED = re.compile(r"^Commit `[0-9a-f]{7,}`, \d{4}-\d\d-\d\d, ", re.MULTILINE)
WEATHERS = ["sunny", "light_rain", "heavy_rain", "night", "snow", "backlight"]


class Absent(Exception):
    """What a table needs is not here."""


class Lookout:
    """Runs the program; a command that several tables need runs once."""

    def __init__(self, program, data):
        self.program, self.data = program, data
        # Removed at the end.
        self.temporary = tempfile.TemporaryDirectory(prefix="results-")
        self.folder = pathlib.Path(self.temporary.name)
        self.done, self.commands = {}, []

    def folder_of(self, name):
        """The folder of a data set."""
        path = self.data / name
        if not path.is_dir():
            raise Absent(f"{path} is not here")
        return path

    def json(self, *arguments, read=None):
        """The JSON that a command prints, or a file that it writes; also where a budget was missed and it exits with 1."""
        arguments = [str(argument) for argument in arguments]
        shown = "lookout " + " ".join(arguments).replace(f"{self.data}/", "")
        shown = re.sub(rf" (--out|-o) {re.escape(str(self.folder))}/\S+", "", shown)
        if shown not in self.commands:
            self.commands.append(shown)
        if shown not in self.done:
            print(f"  {shown}", file=sys.stderr, flush=True)
            start = time.monotonic()
            try:
                run = subprocess.run([self.program, *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True)
                self.done[shown] = json.loads(run.stdout if read is None else pathlib.Path(read).read_text())
            except OSError as error:
                raise Absent(f"{shown}: {error}") from error
            except json.JSONDecodeError as error:
                raise Absent(f"{shown} ended with {run.returncode} and no result") from error
            print(f"    {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
        return self.done[shown]


def number(value, decimals=2):
    return "–" if value is None else f"{value:.{decimals}f}"


def table(head, rows):
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(str(cell) for cell in line) + " |\n" for line in lines)


def mean(rows, key):
    return sum(row[key] for row in rows) / len(rows)


# Stereo


def stereo(lookout):
    def scores(sets, *options):
        report = lookout.json("evaluate", "stereo", *sets, *options, "--json")
        return {scored["set"]: [row for row in scored["rows"] if row["region"] == "noc"] for scored in report["sets"]}

    sets = [lookout.folder_of("kitti2015"), lookout.folder_of("middlebury")]
    near = ["--set", "stereo.ssim_k2=0.01", "--set", "stereo.gradient_limit=12"]
    rows = []
    for name, sets_of, options in [
        ("full", sets, ["--method", "full"]),
        ("fast", sets, ["--method", "fast"]),
        ("full, rows corrected", sets, ["--method", "full", "--correct-rows"]),
        ("fast, rows corrected", sets, ["--method", "fast", "--correct-rows"]),
        ("full, K₂ 0.01, gradient limit 12", sets[1:], ["--method", "full", *near]),
        ("fast, K₂ 0.01, gradient limit 12", sets[1:], ["--method", "fast", *near]),
    ]:
        score = scores(sets_of, *options)
        kitti, middlebury = score.get("kitti2015"), score["middlebury"]
        cells = [number(mean(kitti, key)) if kitti else "" for key in ("dens", "bad1", "bad2", "bad3", "D1", "epe", "val3")]
        halves = [number(mean(kitti[half::2], "bad3")) if kitti else "" for half in (1, 0)]
        near_cells = [number(mean(middlebury, key)) for key in ("dens", "bad1", "bad2", "bad3")]
        rows.append([name, *cells, *halves, *near_cells])
    head = ["", "KITTI 2015: density", "bad-1", "bad-2", "bad-3", "D1", "EPE", "val3", "bad-3 of even pairs", "of odd pairs"]
    return table([*head, "Middlebury: density", "bad-1", "bad-2", "bad-3"], rows)


def stereo_disturbed(lookout):
    kitti = lookout.folder_of("kitti2015")
    rows = []
    for name, option in [
        ("none", None),
        ("gain 0.7", "gain"),
        ("gamma 0.6", "gamma"),
        ("noise of 5 grey levels", "noise"),
        ("blur of 1 px", "blur"),
        ("vertical misalignment of 0.5 px", "vertical"),
    ]:
        cells = [name]
        for method in ("fast", "full"):
            disturb = ["--disturb", option] if option else []
            report = lookout.json("evaluate", "stereo", kitti, "--method", method, *disturb, "--json")
            scored = report["sets"][0]["mean"]["noc"]
            cells.append(f"{scored['bad3']:.2f}, {scored['dens']:.1f}")
        rows.append(cells)
    return table(["one picture disturbed: bad-3, density", "fast", "full"], rows)


# Scenes


def weather_rows(lookout, *scenes):
    threads = ["--threads", "2"]
    return lookout.json("evaluate", "weather", *scenes, *threads, "--json")["rows"]


def detection(rows):
    head = ["weather", "objects", "paper", "detected", "strict", "boxes for each", "false boxes a minute, measured ones"]
    head += ["frames with a false alarm", "road height error, median, 95 %", "right class: of all, of those found"]
    lines = []
    for row in rows:
        lines.append(
            [
                row["weather"].replace("_", " "),
                row["due"],
                number(row.get("paper_rate"), 3),
                number(row["detection_rate"], 3),
                number(row["regions"]["strict_rate"], 3),
                number(row["regions"]["boxes_per_object"]),
                f"{row['false_per_minute']:.0f}, {row['obstacles']['false_per_minute']:.0f}",
                f"{100 * row['false_alarms']:.1f} %",
                f"{100 * row['road_median_m']:.1f}, {100 * row['road_p95_m']:.1f} cm",
                f"{number(row['class_rate'], 3)}, {number(row['class_rate_of_found'], 3)}",
            ]
        )
    return table(head, lines)


def weather(lookout):
    return detection(weather_rows(lookout))


def weather_random(lookout):
    return detection(weather_rows(lookout, "random", "--seeds", "150-157"))


def distances(lookout):
    rows = weather_rows(lookout)
    ranges = [f"{part['from_m']:g} to {part['to_m']:g} m" for part in rows[0]["ranges"]]
    lines = []
    for row in rows:
        parts = [*row["ranges"], row["all"]]
        cells = [f"{number(part['median_percent'])}, {number(part['covered'])}" for part in parts]
        lines.append([row["weather"].replace("_", " "), *cells])
    return table(["weather", *ranges, "all"], lines)


def free_space(lookout):
    lines = []
    for name, rows in [
        ("`street`", weather_rows(lookout)),
        ("seeds 150 to 157", weather_rows(lookout, "random", "--seeds", "150-157")),
    ]:
        for key, what, scale in [("found", "truly free ground found, %", 100), ("wrong_m", "wrongly free, m, mean over the columns", 1)]:
            cells = [number(scale * row["free_space"][key], 1 if scale > 1 else 2) for row in rows]
            lines.append([f"{name}: {what}", *cells])
    return table(["", *(name.replace("_", " ") for name in WEATHERS)], lines)


def approaches(lookout):
    lines = []
    for row in lookout.json("evaluate", "distance", "--json")["approaches"]:
        lines.append(
            [
                f"`{row['scene']}`",
                f"{row['start_m']:.1f} m",
                f"{number(row['first_found_m'], 1)} m",
                row["missed_after"],
                f"{number(row['alarm_m'], 1)} m",
                f"{number(row['alarm_ttc_s'])} s",
                f"{number(row['warning_ttc_s'])} s",
                f"{number(row['distance_median_percent'])} %",
                number(row["covered"]),
                f"{number(row['ttc_median_percent'], 1)}, {number(row['ttc_worst_percent'], 1)} %",
            ]
        )
    head = ["approach", "from", "first found", "missed after", "alarm at", "alarm at TTC", "warning at TTC"]
    return table([*head, "distance error, median", "within bar", "TTC error from 2.5 s down: median, worst"], lines)


def silent(lookout):
    lines = []
    for row in lookout.json("evaluate", "distance", "--json")["silent"]:
        frames = [row[key] for key in ("frames", "alarm_frames", "warning_frames", "off_frames")]
        lines.append([f"`{row['scene']}`", *frames, row["false_regions"], row["stray_regions"]])
    head = ["silent scene", "frames", "with alarm", "with warning", "alarm off", "false boxes on the road", "beside it"]
    return table(head, lines)


# Standard tests

NCAP_SPEEDS = ["20", "40", "60", "80"]
NCAP_SEEDS = ["--seeds", "110-110", "--threads", "2", "--json"]


def ncap(rig, *arguments):
    """The rows by speed with a rig, by day and at night; what was passed."""

    def rows(lookout):
        impacts = ["evaluate", "ncap", "--rig", rig, "--nominal", "--speeds", ",".join(NCAP_SPEEDS), "--only", "impacts"]
        runs = lookout.json(*impacts, *arguments, *NCAP_SEEDS)["runs"]
        is_night = lambda run: run["weather"] == "night"
        names = list(dict.fromkeys((run["row"], is_night(run)) for run in sorted(runs, key=is_night)))
        lines = []
        for row, night in names:
            of_row = [run for run in runs if (run["row"], is_night(run)) == (row, night)]
            cells = [ncap_cell([run for run in of_row if f"{run['own_km_h']:g}" == speed]) for speed in NCAP_SPEEDS]
            if any(run["passed"] is not None for run in of_row):
                lines.append([row + (", night" if night else ""), *cells])
        times = [(words, night) for words, night in [("By day", False), ("at night", True)] if any(is_night(run) == night for run in runs)]
        sums = "; ".join(f"{words} {ncap_sum([run for run in runs if is_night(run) == night])}" for words, night in times)
        return table(["row", *(f"{speed} km/h" for speed in NCAP_SPEEDS)], lines) + f"\n{sums}.\n"

    return rows


def ncap_sum(runs):
    judged = [run for run in runs if run["passed"] is not None]
    cells = {}
    for run in judged:
        cells.setdefault((run["row"], run["own_km_h"]), []).append(run["passed"])
    by_seed = [sum(run["passed"] for run in judged if run["seed"] == seed) for seed in sorted({run["seed"] for run in judged})]
    share = 100 * sum(by_seed) / max(len(judged), 1)
    text = f"**{sum(by_seed)} of {len(judged)} judged runs pass** ({share:.0f} %; by seed {', '.join(map(str, by_seed))}), "
    return text + f"{sum(map(all, cells.values()))} of {len(cells)} cells with all seeds"


def ncap_cell(runs):
    if not runs:
        return ""
    judged = [run["passed"] for run in runs if run["passed"] is not None]
    words = f"{sum(judged)} of {len(judged)}" if judged else "(not judged)"
    words = f"**{words}**" if judged and all(judged) else words
    ttc = [sorted(run["ttc_s"][key] for run in runs if run["ttc_s"][key] is not None) for key in ("warning", "alarm")]
    medians = [number(times[len(times) // 2] if times else None) for times in ttc]
    impact = lambda run: run["free_impact_m_s"] if run["impact_m_s"] is None else run["impact_m_s"]
    return f"{words}: {medians[0]} / {medians[1]} / {max(round(impact(run) * 3.6) for run in runs)}"


def ncap_near(lookout):
    """How many near misses of each row are silent, and which are not."""
    near = ["evaluate", "ncap", "--rig", "board", "--nominal", "--speeds", "40", "--only", "near-misses", "--weather", "sunny"]
    runs = [run for run in lookout.json(*near, *NCAP_SEEDS)["runs"] if run["passed"] is not None]
    lines = []
    for row in dict.fromkeys(run["row"] for run in runs):
        of_row = [run for run in runs if run["row"] == row]
        loud = [f"{run['miss']}, seed {run['seed']}: {'; '.join(run['reasons'])}" for run in of_row if not run["passed"]]
        lines.append([row, f"{sum(run['passed'] for run in of_row)} of {len(of_row)}", "<br>".join(loud)])
    silent_runs = sum(run["passed"] for run in runs)
    return table(["row", "silent", "not silent"], lines) + f"\n**{silent_runs} of {len(runs)} near misses are silent.**\n"


# Recordings


def drives(lookout):
    residential, sequence = lookout.folder_of("drive_residential"), lookout.folder_of("kitti_sequence_1")
    path = ["--oxts", residential / "oxts.csv", "--times", residential / "timestamps.csv"]
    rectified = ["--rig", residential / "rig.toml", "--set", "source.rectify=true"]
    lines = []
    for name, arguments in [
        ("KITTI 2011-09-26 residential", [residential, *rectified, *path]),
        ("KITTI odometry", [sequence, "--poses", sequence / "poses.txt"]),
    ]:
        row = lookout.json("evaluate", "drive", *arguments, "--json")["total"]
        # Where fewer than half of the tracks were lost, the longest life is a lower limit.
        over = ">" if row["life_is_lower_limit"] else ""
        lines.append(
            [
                f"{name}, {row['frames']} frames",
                f"{row['off_percent']:.0f} %",
                f"{row['warnings']}, {row['alarms']}",
                f"{row['false_obstacles']} in {row['judged']} frames",
                f"{over}{row['life_median_s']:.1f} s, {row['life_strict_s']:.1f} s",
                f"{row['width_jumps_percent']:.1f} %",
                f"{row['predicted_percent']:.1f} %",
                f"{row['not_free_percent']:.1f} %",
            ]
        )
    head = ["drive", "alarm off", "warnings, alarms", "false obstacles in the strip", "tracks live (median), strictly"]
    return table([*head, "width jumps", "predictions", "driven strip not free"], lines)


def lidar(lookout):
    sets = [lookout.folder_of("kitti_depth"), lookout.folder_of("kitti_cars")]
    report = lookout.json("evaluate", "lidar", *sets, "--json")
    heights = [row["camera_height_m"] for row in report["pictures"] if row["camera_height_m"] is not None]
    lines = [
        ["labelled cars within 40 m covered by a box", f"{report['covered']} of {report['due']}"],
        ["boxes for each of them", number(report["boxes_per_car"])],
    ]
    for name, key in [("these cars", "cars"), ("boxes of matched pairs", "matched"), ("boxes of depth maps", "depth_map")]:
        errors = report[key]
        figures = f"{number(errors['median_percent'])} %, {number(errors['p90_percent'])} %, {number(errors['bias_percent'])} %"
        lines.append([f"distance error of {name}, {errors['count']}: median, nine of ten, signed median", figures])
    seen = f"{len(heights)} of {len(report['pictures'])}; {min(heights):.2f} to {max(heights):.2f} m"
    lines.append(["road seen; height of the camera (KITTI: 1.65 m)", seen])
    return table(["what", "figure"], lines)


def calibration(lookout):
    board = lookout.folder_of("chessboard_sg1")
    size = ["--board", "9x6", "--square-mm", "24.23"]
    rig = lookout.folder / "rig.toml"
    report = lookout.json("calibrate", board, *size, "-o", rig, "--cross-validate", "--json")
    every = report["all_views"]
    lines = [
        ["pairs", report["pairs_used"], every["pairs_used"]],
        ["stereo reprojection error", f"{report['rms_px']:.3f} px", f"{every['rms_px']:.3f} px"],
        ["row error in held-out views", f"{report['vertical_heldout_px']:.3f} px", f"{every['vertical_heldout_px']:.3f} px"],
        [
            "baseline",
            f"{1000 * report['baseline_m']:.2f} ± {1000 * report['baseline_sigma_m']:.2f} mm",
            f"{1000 * every['baseline_m']:.2f} mm",
        ],
        ["processor time", f"{report['cpu_seconds']:.2f} s, both solutions", ""],
    ]
    return table(["what", "pairs that agree", "all pairs"], lines)


# The daemon


def processes(summary):
    rows = {row["role"]: row for row in summary["processes"]}
    stages = ["capture", "stereo", "road", "recognition"]
    times = [f"{rows[stage]['work']['p50_ms']:.1f} / {rows[stage]['work']['p99_ms']:.1f} ms" for stage in stages]
    memory = [f"{rows[stage]['private_bytes'] / 2**20:.1f} MiB" for stage in stages]
    total = sum(row["private_bytes"] for row in summary["processes"]) + summary["shared_bytes"] + summary["file_bytes"]
    end = summary["latency"]
    return [
        ["work, p50 / p99", *times, f"{end['p50_ms']:.1f} / {end['p99_ms']:.1f} ms"],
        ["private memory", *memory, f"{total / 2**20:.1f} MiB with shared memory and program, counted once"],
    ]


def pipeline(lookout):
    sequence = lookout.folder_of("kitti_sequence_1")
    out = lookout.folder / "replay"
    summary = lookout.json("replay", sequence, "--lockstep", "--out", out, read=out / "summary.json")
    head = [f"{summary['frames']} of {summary['offered']} pairs", "capture (PNG)", "stereo, fast", "road", "recognition"]
    return table([*head, "end to end"], processes(summary))


def demo(lookout):
    out = lookout.folder / "demo"
    summary = lookout.json("demo", "--out", out, read=out / "summary.json")
    head = [f"{summary['frames']} of {summary['offered']} pairs, {summary['rate_hz']:.1f} a second"]
    return table([*head, "capture (scene)", "stereo, fast", "road", "recognition", "end to end"], processes(summary))


def soak_report(lookout, name, *arguments):
    out = lookout.folder / f"soak-{name}"
    return lookout.json("soak", *arguments, "--out", out, read=out / "soak.json")


SOAKS = {
    "soak": ["--minutes", "20"],
    "soak-faults": ["--minutes", "20", "--faults", "--seed", "7"],
    "soak-kills": ["--kills", "1000", "--seed", "1"],
    "soak-overload": ["--overload", "--minutes", "5"],
    "soak-hour": ["--minutes", "60"],
    "soak-hour-faults": ["--minutes", "60", "--faults", "--seed", "7"],
}


def soak(name):
    def measure(lookout):
        report = soak_report(lookout, name, *SOAKS[name])
        latency, sound = report["latency_ms"], report["latency_less_stalls_ms"]
        machine = report["machine"]
        growth = report["rss_slope_bytes_per_hour"]
        work = {row["role"]: row["work_ms"] for row in report["stages"]}
        lines = [
            ["verdict", " ".join([report["verdict"], *report["reasons"]])],
            ["results of pairs; rate", f"{report['frames']} of {report['offered']}; {report['rate_hz']:.2f}/s"],
            ["end to end p50 / p99 / p99.9", f"{latency['p50']:.1f} / {latency['p99']:.1f} / {latency['p999']:.1f} ms"],
            ["less machine stalls", f"{sound['p50']:.1f} / {sound['p99']:.1f} / {sound['p999']:.1f} ms"],
            [
                "work of stereo, road, recognition, p50",
                ", ".join(f"{work[stage]['p50']:.1f}" for stage in ("stereo", "road", "recognition")) + " ms",
            ],
            [
                "resident memory; growth",
                f"{report['rss_bytes'] / 1e6:.1f} MB; " + ("–" if growth is None else f"{growth / 1024:.0f} KiB/h"),
            ],
            ["processor time, of all cores", f"{report['cpu_percent']:.1f} %"],
        ]
        if report["faults"]:
            faults = f"{report['faults']}, {report['kills']}, {report['restarts']}, {report['failed_restarts']}"
            lines.append(["faults, SIGKILLs among them, restarts, failed ones", faults])
            lines.append(["longest time to the next result", f"{report['next_result_s_max']:.2f} s"])
        lines.append(["entries left in shared memory", report["leaked_shm_entries"]])
        others = f"{machine['others_cpu_percent']:.0f} % of all cores; {machine['stolen_percent']:.1f} % stolen"
        lines.append(["other work beside it", others])
        return table(["what", "figure"], lines)

    return measure


TABLES = {
    "stereo": stereo,
    "stereo-disturbed": stereo_disturbed,
    "weather": weather,
    "weather-random": weather_random,
    "distances": distances,
    "free-space": free_space,
    "approaches": approaches,
    "silent": silent,
    "ncap": ncap("board"),
    "ncap-paper": ncap("paper", "--weather", "sunny"),
    "ncap-near": ncap_near,
    "drives": drives,
    "lidar": lidar,
    "calibration": calibration,
    "pipeline": pipeline,
    "demo": demo,
    **{name: soak(name) for name in SOAKS},
}


def git(*arguments):
    run = subprocess.run(["git", *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return run.stdout.strip()


def machine():
    """This machine in words: processor, cores, vector instructions that the matcher uses, memory."""
    info = pathlib.Path("/proc/cpuinfo").read_text()
    model = re.search(r"^model name\s*: (.*)$", info, re.MULTILINE)
    flags = re.search(r"^(?:flags|Features)\s*: (.*)$", info, re.MULTILINE)
    flags = flags.group(1).split() if flags else []
    level = next((name for flag, name in [("avx512bw", "AVX-512"), ("avx2", "AVX2"), ("asimd", "NEON")] if flag in flags), "")
    kib = int(re.search(r"^MemTotal:\s*(\d+) kB", pathlib.Path("/proc/meminfo").read_text(), re.MULTILINE).group(1))
    cores = len(os.sched_getaffinity(0))
    words = [model.group(1).strip() if model else os.uname().machine, f"{cores} cores", level, f"{kib / 2**20:.0f} GiB"]
    return ", ".join(word for word in words if word)


def measured(lookout, name, commit):
    """A table with where it comes from."""
    lookout.commands = []
    figures = TABLES[name](lookout)
    commands = "; ".join(f"`{command}`" for command in lookout.commands)
    today = datetime.date.today().isoformat()
    return f"Commit `{commit}`, {today}, {machine()}: {commands}.\n\n{figures}"


def blocks():
    """Page, name and text of each table in the documentation."""
    for page in PAGES:
        for block in BLOCK.finditer(page.read_text()):
            yield page, block["name"], block["body"]


def check():
    """What is wrong with the tables in the documentation."""
    faults = []
    for page in PAGES:
        text = page.read_text()
        opened, closed = len(re.findall(r"^<!-- table: ", text, re.MULTILINE)), len(list(BLOCK.finditer(text)))
        if opened != closed:
            faults.append(f"{page.relative_to(ROOT)}: {opened} tables begin, {closed} are whole")
    for page, name, body in blocks():
        if name not in TABLES:
            faults.append(f"{page.relative_to(ROOT)}: no such table: {name}")
        elif not MEASURED.search(body):
            faults.append(f"{page.relative_to(ROOT)}: the table {name} does not say what it was measured with")
    return faults


def write(name, text):
    """Replaces a table in the page that has it."""
    for page in PAGES:
        before = page.read_text()
        put = lambda block: block.group(0) if block["name"] != name else f"<!-- table: {name} -->\n{text}<!-- end of table -->\n"
        after = BLOCK.sub(put, before)
        if after != before:
            page.write_text(after)


def main():
    parser = argparse.ArgumentParser(
        description="Measures the tables of the documentation again.",
        epilog="examples: docs/results.py --list; docs/results.py weather; docs/results.py --write stereo lidar drives",
    )
    parser.add_argument("tables", nargs="*", metavar="NAME", help="tables to measure; all: every one in the documentation")
    parser.add_argument("--list", action="store_true", help="list the tables and the pages that have them")
    parser.add_argument("--check", action="store_true", help="check the tables in the documentation; measures nothing")
    parser.add_argument("--write", action="store_true", help="replace them in the documentation; needs a committed tree")
    parser.add_argument("--lookout", metavar="FILE", help="the program [default: built from this tree]")
    parser.add_argument("--data", type=pathlib.Path, default=ROOT.parent / "shared/data", help="folder of the recorded data [default: shared/data beside the checkout]")
    arguments = parser.parse_args()

    pages = {name: page.relative_to(ROOT) for page, name, _ in blocks()}
    if arguments.check:
        faults = check()
        print("\n".join(faults) or f"{len(pages)} tables")
        return 1 if faults else 0
    if arguments.list or not arguments.tables:
        for name in TABLES:
            print(f"{name:18} {pages.get(name, 'in no page')}")
        return 0
    names = list(pages) if arguments.tables == ["all"] else arguments.tables
    unknown = [name for name in names if name not in TABLES]
    if unknown:
        parser.error(f"no such table: {', '.join(unknown)}; --list has them")
    changed = bool(git("status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude)docs", ":(exclude)*.md"))
    if arguments.write and changed:
        parser.error("--write needs a committed tree: figures are of a commit")
    # Before the program is built: what is committed while it measures is not what it measures.
    commit = git("rev-parse", "--short=7", "HEAD") + (" with changes" if changed else "")
    program = arguments.lookout
    if program is None:
        subprocess.run(["cargo", "build", "--release", "--locked"], cwd=ROOT, check=True)
        program = ROOT / "target/release/lookout"
    lookout = Lookout(pathlib.Path(program).resolve(), arguments.data.resolve())
    failed = 0
    for name in names:
        print(f"{name}:", file=sys.stderr, flush=True)
        try:
            text = measured(lookout, name, commit)
        except Absent as absent:
            print(f"{name} stays as it is: {absent}", file=sys.stderr)
            failed += 1
            continue
        if arguments.write:
            write(name, text)
        else:
            print(f"{text}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
