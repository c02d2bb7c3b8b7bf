"""What all readers together cost the pipeline: the same replay at live rate with and without them, in turns.

    latency.py LOOKOUT RECORDING [--fps 12.5] [--frames 200] [--rounds 4] [--set LINE …] [--bridge] [--can INTERFACE]
               [--client PROGRAM …] [--busy] [--within PERCENT]

Readers: `lookout stream` (its lines are read), `lookout stream --serve` with a reader of its socket, `lookout view` with a page
that asks for all pictures again and again, `lookout record` with its default topics, and a client of shared memory with pictures
(the Python package; LOOKOUT_LIBRARY names liblookout.so). Further ones on request:

    --bridge        `lookout bridge --ros2`, and a subscriber of everything (package eclipse-zenoh; feature zenoh)
    --can vcan0     `lookout can` on this interface (feature can). It reads the same where there is no such interface, and
                    tries to open it once a second
    --client PROGRAM    a client in Rust or C, started as PROGRAM INSTANCE FOLDER, whose lines are counted, such as
                    target/release/examples/nearest. The daemon has six places for readers of disparity maps: two are its
                    own, so with the page, the Python client and --bridge there is one more

A reader that gets nothing in a turn ends the measurement with an error. With --busy a loop at the idle priority keeps each core
awake in both kinds of turns: on a machine whose cores fall asleep between frames, readers make the pipeline faster, because they
keep them awake. The figures are the daemon's own, from summary.json of each turn; the first round is run, but not counted. In
every second round the turn with readers comes first. Prints a table, the ratio of the medians, and the ratios round by round with
their quartiles: give --rounds 10 or more for these. The spread between turns without readers is the noise of the machine. With
--within 5 it fails if the median of the rounds' ratios is above 1.05 for p50 or p99.
"""

import argparse
import base64
import json
import os
import pathlib
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time

FIGURES = ("p50", "p99")
ROOT = pathlib.Path(__file__).resolve().parents[2]
QUESTION = b'{"want":["left","disparity","v_disparity","points"],"frames":true}'


class Page:
    """A page of the viewer: one request after the other, over a WebSocket."""

    def __init__(self, address):
        host, port = address.split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=30)
        self.file = self.socket.makefile("rb")
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET /socket HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert b"101" in self.file.readline()
        while self.file.readline().strip():
            pass

    def ask(self):
        mask = os.urandom(4)
        masked = bytes(b ^ mask[i % 4] for i, b in enumerate(QUESTION))
        self.socket.sendall(bytes([0x81, 0x80 | len(QUESTION)]) + mask + masked)
        while True:
            first, length = self.file.read(2)
            if length == 126:
                (length,) = struct.unpack(">H", self.file.read(2))
            elif length == 127:
                (length,) = struct.unpack(">Q", self.file.read(8))
            content = self.file.read(length)
            if first & 0x0F == 2:
                return len(content)


class Readers:
    """All readers, each counting what it gets."""

    def __init__(self, arguments, config, folder):
        binary = arguments.lookout
        self.folder = folder
        self.counts = {}
        self.over = threading.Event()
        self.threads = []
        lookout = lambda *args, **more: subprocess.Popen(
            [binary, *args, "-c", config], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **more
        )
        stream = lookout("stream", stdout=subprocess.PIPE)
        view = lookout("view", "--bind", "127.0.0.1:0", stdout=subprocess.PIPE, text=True)
        self.processes = [stream, view, lookout("stream", "--serve", stdout=subprocess.DEVNULL)]
        address = view.stdout.readline().split()[-1].removeprefix("http://").split("/")[0]
        self.run("stream", lambda count: [count() for _ in stream.stdout])
        self.run("socket", lambda count: self.read_socket(folder / "socket", count))
        self.run("page", lambda count: self.read_page(address, count))
        client = pathlib.Path(__file__).with_name("client.py")
        reader = subprocess.Popen([sys.executable, client, folder.name, folder / "run"], stdout=subprocess.PIPE)
        self.processes.append(reader)
        self.run("client", lambda count: [count() for _ in reader.stdout])
        for number, program in enumerate(arguments.client, 1):
            # By lines: what a program in C keeps back when it is ended would not be counted.
            self.run_client(f"client {number}", ["stdbuf", "-oL", program, folder.name, folder / "run"])
        self.recorder = None
        self.run("record", lambda count: self.record(lookout, count))
        if arguments.can:
            settings = ["--set", f"can_out.interface={arguments.can}"]
            can = lookout("can", *settings, stdout=subprocess.DEVNULL)
            self.processes.append(can)
            self.run("can", lambda count: self.read_can(can.pid, count))
        if arguments.bridge:
            script = ROOT / "tests/bridge/subscribe.py"
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
            self.subscriber = subprocess.Popen(
                [sys.executable, script, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            assert self.subscriber.stdout.readline() == "ready\n"
            settings = ["--set", f"bridge.connect={endpoint}", "--set", f"bridge.spool={folder / 'spool'}"]
            self.processes.append(lookout("bridge", "--ros2", *settings, stdout=subprocess.DEVNULL))
        else:
            self.subscriber = None

    def run(self, name, work):
        self.counts[name] = 0

        def count():
            self.counts[name] += 1

        def guarded():
            try:
                work(count)
            except (OSError, ValueError) as error:
                if not self.over.is_set():
                    print(f"{name}: {error}", file=sys.stderr)

        self.threads.append(threading.Thread(target=guarded, daemon=True))
        self.threads[-1].start()

    def run_client(self, name, command):
        client = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.processes.append(client)
        self.run(name, lambda count: [count() for _ in client.stdout])

    def record(self, lookout, count):
        """`lookout record` needs a daemon that runs, and ends with it."""
        while self.counts["stream"] == 0:
            if self.over.wait(0.05):
                return
        # Its report at the end is not long enough to fill the pipe.
        self.recorder = lookout("record", "-o", self.folder / "readers.mcap", "--json", stdout=subprocess.PIPE)
        report = json.load(self.recorder.stdout)
        for _ in range(report["frames"]):
            count()

    def read_can(self, pid, count):
        """`lookout can` tells once a second, in the daemon's folder, how the bus does."""
        while not self.over.wait(1.0):
            for path in self.folder.glob("run/**/can_out"):
                try:
                    told = json.loads(path.read_text())
                except (OSError, ValueError):
                    continue  # It is just being written, or the daemon has ended.
                if told["pid"] == pid:
                    count()

    def read_socket(self, path, count):
        while not path.exists():
            if self.over.wait(0.05):
                return
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(str(path))
            for _ in connection.makefile("rb"):
                count()

    def read_page(self, address, count):
        page = Page(address)
        while not self.over.is_set():
            page.ask()
            count()

    def end(self):
        self.over.set()
        if self.recorder:
            self.recorder.wait(timeout=60)
        if self.subscriber:
            self.subscriber.stdin.close()
            got = json.loads(self.subscriber.stdout.readline() or "{}")
            self.counts["bridge"] = sum(got.get("topics", {}).values()) + sum(t["count"] for t in got.get("ros", {}).values())
        for process in self.processes:
            process.send_signal(signal.SIGTERM)
        for process in self.processes:
            process.wait()
        for thread in self.threads:
            thread.join(timeout=10)
        (self.folder / "readers.mcap").unlink(missing_ok=True)
        return self.counts


def keep_awake():
    """A loop at the idle priority for each core."""
    burn = "import os\nos.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))\nwhile True: pass"
    return [subprocess.Popen([sys.executable, "-c", burn]) for _ in range(os.cpu_count())]


def turn(arguments, folder, with_readers):
    config = folder / "car.toml"
    command = [arguments.lookout, "replay", arguments.recording, "-c", config, "--fps", str(arguments.fps), "--loop"]
    command += ["--limit", str(arguments.frames), "--out", folder / "out"]
    readers = Readers(arguments, config, folder) if with_readers else None
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    counts = readers.end() if readers else {}
    if idle := [name for name, count in counts.items() if count == 0]:
        sys.exit(f"these readers got nothing: {', '.join(idle)}; all: {counts}")
    summary = json.loads((folder / "out/summary.json").read_text())
    subprocess.run(["rm", "-rf", folder / "out"], check=True)
    latency = summary["latency"]
    skipped = sum(process.get("skipped", 0) for process in summary["processes"])
    return {"p50": latency["p50_ms"], "p99": latency["p99_ms"], "frames": summary["frames"], "skipped": skipped, "counts": counts}


def print_table(turns):
    """Medians of the turns and the spread between them, and the ratio of the medians."""
    print(f"{'':<14}{'p50':>8}{'spread':>8}{'p99':>8}{'spread':>8}{'frames':>8}{'skipped':>8}")
    medians = {}
    for with_readers, name in ((False, "without"), (True, "with readers")):
        of = lambda figure: [result[figure] for result in turns[with_readers]]
        medians[with_readers] = {figure: statistics.median(of(figure)) for figure in FIGURES}
        columns = [value for f in FIGURES for value in (medians[with_readers][f], max(of(f)) - min(of(f)))]
        print(f"{name:<14}" + "".join(f"{value:>8.1f}" for value in columns) + f"{sum(of('frames')):>8}{sum(of('skipped')):>8}")
    print("ratio of the medians: " + ", ".join(f"{f} {medians[True][f] / medians[False][f]:.3f}" for f in FIGURES))


def print_ratios(turns):
    """The ratio of each round, and how they spread; gives the median for each figure."""
    medians = {}
    for figure in FIGURES:
        ratios = [a[figure] / b[figure] for a, b in zip(turns[True], turns[False])]
        medians[figure] = statistics.median(ratios)
        low, _, high = statistics.quantiles(ratios, n=4, method="inclusive") if len(ratios) > 1 else [ratios[0]] * 3
        print(
            f"ratio by round, {figure}: median {medians[figure]:.3f}, quartiles {low:.3f} to {high:.3f}, "
            f"all {min(ratios):.3f} to {max(ratios):.3f} ({len(ratios)} rounds: {' '.join(f'{r:.3f}' for r in ratios)})"
        )
    return medians


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("lookout")
    parser.add_argument("recording")
    parser.add_argument("--fps", type=float, default=12.5)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--bridge", action="store_true")
    parser.add_argument("--can", metavar="INTERFACE")
    parser.add_argument("--client", action="append", default=[], metavar="PROGRAM")
    parser.add_argument("--busy", action="store_true")
    parser.add_argument("--within", type=float, metavar="PERCENT")
    arguments = parser.parse_args()
    if arguments.rounds < 1:
        parser.error("--rounds: at least 1")
    turns = {False: [], True: []}
    loops = keep_awake() if arguments.busy else []
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            instance = folder / f"l{os.getpid()}"
            instance.mkdir()
            text = f'[instance]\nname = "{instance.name}"\ndirectory = "{instance / "run"}"\n[stream]\nsocket = "{instance / "socket"}"\n'
            (instance / "car.toml").write_text(text + "\n".join(arguments.set) + "\n")
            for round_ in range(arguments.rounds + 1):
                for with_readers in (False, True) if round_ % 2 == 0 else (True, False):
                    result = turn(arguments, instance, with_readers)
                    print(round_, "with readers" if with_readers else "without", result, file=sys.stderr, flush=True)
                    if round_ > 0:
                        turns[with_readers].append(result)
    finally:
        for loop in loops:
            loop.kill()
    print_table(turns)
    medians = print_ratios(turns)
    print("read in the last turn:", turns[True][-1]["counts"])
    if arguments.within is not None and max(medians.values()) > 1 + arguments.within / 100:
        sys.exit(f"not within {arguments.within:g} %")


if __name__ == "__main__":
    main()
