"""A fleet of simulated vehicles against one router on this machine: messages a second, loss, delay, memory, processor time.

    simulate.py [--vehicles 100] [--seconds 30] [--processes 4] [--speedup 1] [--sizes obstacles=3000,alarm=400,…]

Each vehicle has a session of its own with the keys of `lookout bridge`: a liveliness token, obstacles 5 Hz,
alarm 2 Hz, motion 2 Hz, status 0.2 Hz; an event with three pictures every ten minutes. The router is a process of its own, and
so is the subscriber, which gets everything. --speedup multiplies all rates. The table of the run in docs/fleet.md comes from it, with the sizes named there. Needs the
package eclipse-zenoh.
"""

import argparse
import json
import multiprocessing
import os
import random
import resource
import time

RATES = {"obstacles": 5.0, "alarm": 2.0, "motion": 2.0, "status": 0.2, "events": 1 / 600, "pictures": 3 / 600}


def session(mode, connect=None, listen=None):
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    # Vehicles are on other machines.
    config.insert_json5("transport/shared_memory/enabled", "false")
    if connect:
        config.insert_json5("connect/endpoints", json.dumps([connect]))
    if listen:
        config.insert_json5("listen/endpoints", json.dumps([listen]))
    return zenoh.open(config)


def figures():
    """Resident memory in MB, and processor time in seconds, of this process."""
    with open("/proc/self/statm") as file:
        pages = int(file.read().split()[1])
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return {"rss_mb": pages * os.sysconf("SC_PAGESIZE") / 1e6, "cpu_s": usage.ru_utime + usage.ru_stime}


def router(endpoint, pipe):
    with session("router", listen=endpoint):
        pipe.send(figures())
        while pipe.recv() != "end":
            pipe.send(figures())


def subscriber(endpoint, pipe):
    counts, lost, delays, last = {}, 0, [], {}

    def take(sample):
        nonlocal lost
        payload = sample.payload.to_bytes()
        number, sent = int.from_bytes(payload[:8], "little"), int.from_bytes(payload[8:16], "little")
        key = str(sample.key_expr)
        topic = key.split("/")[3]
        counts[topic] = counts.get(topic, 0) + 1
        lost += number - last.get(key, -1) - 1
        last[key] = number
        delays.append((time.monotonic_ns() - sent) / 1e6)

    with session("client", connect=endpoint) as client:
        keep = client.declare_subscriber("lookout/**", take)
        pipe.send("ready")
        while (word := pipe.recv()) != "end":
            if word == "vehicles":
                alive = client.liveliness().get("lookout/*/*/alive", timeout=10.0)
                pipe.send(sum(1 for reply in alive if reply.ok is not None))
        delays.sort()
        at = lambda share: delays[int(share * (len(delays) - 1))] if delays else None
        total = sum(counts.values())
        pipe.send({"counts": counts, "received": total, "lost": lost, "delay_p50_ms": at(0.5), "delay_p99_ms": at(0.99)} | figures())


def vehicles(endpoint, names, sizes, seconds, speedup, barrier, queue):
    fleet = []
    for name in names:
        client = session("client", connect=endpoint)
        fleet.append((client, client.liveliness().declare_token(f"lookout/sim/{name}/alive"), name))
    barrier.wait()
    due = []
    begin = time.monotonic()
    for client, _, name in fleet:
        for topic, rate in RATES.items():
            period = 1 / (rate * speedup)
            due.append([begin + random.random() * period, period, client, f"lookout/sim/{name}/{topic}", sizes[topic], 0])
    sent, late = 0, 0
    padding = {size: os.urandom(size) for size in sizes.values()}
    while (now := time.monotonic()) < begin + seconds:
        waits = begin + seconds
        for entry in due:
            if entry[0] <= now:
                entry[2].put(entry[3], entry[5].to_bytes(8, "little") + time.monotonic_ns().to_bytes(8, "little") + padding[entry[4]])
                entry[5] += 1
                sent += 1
                late += now - entry[0] > entry[1]
                entry[0] += entry[1]
            waits = min(waits, entry[0])
        time.sleep(max(0.0, min(waits - time.monotonic(), 0.01)))
    barrier.wait()
    queue.put({"sent": sent, "late": late} | figures())
    barrier.wait()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=30)
    parser.add_argument("--processes", type=int, default=4)
    parser.add_argument("--speedup", type=float, default=1)
    parser.add_argument("--sizes", default="obstacles=3000,alarm=450,motion=500,status=5000,events=700,pictures=60000")
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:17447")
    arguments = parser.parse_args()
    sizes = {name: int(size) for name, size in (pair.split("=") for pair in arguments.sizes.split(","))}
    context = multiprocessing.get_context("spawn")
    (router_end, router_pipe), (reader_end, reader_pipe) = context.Pipe(), context.Pipe()
    barrier, queue = context.Barrier(arguments.processes + 1), context.Queue()
    processes = [context.Process(target=router, args=(arguments.endpoint, router_pipe))]
    processes[0].start()
    empty = router_end.recv()
    processes.append(context.Process(target=subscriber, args=(arguments.endpoint, reader_pipe)))
    processes[1].start()
    assert reader_end.recv() == "ready"
    names = [f"car-{i}" for i in range(arguments.vehicles)]
    for i in range(arguments.processes):
        own = names[i :: arguments.processes]
        args = (arguments.endpoint, own, sizes, arguments.seconds, arguments.speedup, barrier, queue)
        processes.append(context.Process(target=vehicles, args=args))
        processes[-1].start()
    barrier.wait()
    begin = time.monotonic()
    router_end.send("figures")
    connected = router_end.recv()
    reader_end.send("vehicles")
    alive = reader_end.recv()
    barrier.wait()
    seconds = time.monotonic() - begin
    time.sleep(2)
    router_end.send("figures")
    full = router_end.recv()
    sent = [queue.get() for _ in range(arguments.processes)]
    reader_end.send("end")
    received = reader_end.recv()
    barrier.wait()
    router_end.send("end")
    for process in processes:
        process.join()
    total = sum(of["sent"] for of in sent)
    report = {
        "vehicles": arguments.vehicles,
        "alive": alive,
        "seconds": round(seconds, 1),
        "sent": total,
        "sent_late": sum(of["late"] for of in sent),
        "received": received["received"],
        "lost": total - received["received"],
        "gaps": received["lost"],
        "messages_per_s": round(total / seconds),
        "megabytes_per_s": round(sum(received["counts"].get(t, 0) * s for t, s in sizes.items()) / seconds / 1e6, 2),
        "delay_p50_ms": round(received["delay_p50_ms"], 2),
        "delay_p99_ms": round(received["delay_p99_ms"], 2),
        "router_rss_mb": [round(of["rss_mb"], 1) for of in (empty, connected, full)],
        "router_cpu_percent": round(100 * (full["cpu_s"] - connected["cpu_s"]) / seconds, 1),
        "subscriber_cpu_s": round(received["cpu_s"], 1),
    }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
