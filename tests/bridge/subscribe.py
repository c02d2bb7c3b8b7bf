"""A router and subscriber for the tests of `lookout bridge`: gets every event of every vehicle, and decodes what ROS 2 gets.

    subscribe.py ENDPOINT         such as tcp/127.0.0.1:7447

Prints "ready"; at the end of standard input it prints one JSON document, and ends. Needs eclipse-zenoh and rosbags.

How it misses no event: when a vehicle's liveliness token appears, and whenever a number is skipped, it asks the vehicle for
the events that it has not got. Numbers that it has are dropped.
"""

import json
import sys
import threading

import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

VISION = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}
store = get_typestore(Stores.ROS2_JAZZY)
store.register({name: definition for text in VISION for name, definition in get_types_from_msg(VISION[text], text).items()})

lock = threading.Lock()
events, pictures, topics, problems, tokens, appeared = {}, {}, {}, [], set(), 0
ros = {}
missing = threading.Event()


def take(key, payload):
    parts = key.split("/")
    vehicle, rest = "/".join(parts[:3]), parts[3:]
    with lock:
        if rest[0] == "events" and len(rest) == 2:
            known = events.setdefault(vehicle, {})
            number = int(rest[1])
            if number > 1 and number - 1 not in known:
                missing.set()
            event = json.loads(payload)
            if known.setdefault(number, event) != event:
                problems.append(f"event {number} came with two contents")
        elif rest[0] == "events":
            ends = (payload[:2], payload[-2:])
            if ends != (b"\xff\xd8", b"\xff\xd9"):
                problems.append(f"{key} is no JPEG")
            pictures.setdefault(rest[1], set()).add(int(rest[3]))
        else:
            line = json.loads(payload)
            topics.setdefault(rest[0], []).append(line.get("sequence"))


def take_ros(sample):
    key, payload = str(sample.key_expr), sample.payload.to_bytes()
    try:
        domain, *name, kind, digest = key.split("/")
        kind = kind.replace("::dds_::", "/").replace("::", "/").rstrip("_")
        if store.hash_rihs01(kind) != digest:
            raise ValueError(f"{kind} has the hash {store.hash_rihs01(kind)}, not {digest}")
        message = store.deserialize_cdr(payload, kind)
        # Nothing was lost or added on the way through the other implementation.
        if bytes(store.serialize_cdr(message, kind)) != payload:
            raise ValueError(f"{kind}: {len(payload)} bytes are other ones when they are written again")
        attachment = sample.attachment.to_bytes()
        number = int.from_bytes(attachment[:8], "little")
        if len(attachment) != 33 or attachment[16] != 16 or number < 1:
            raise ValueError(f"{kind}: the attachment {attachment.hex()}")
        found = {"count": 0, "seconds": message.header.stamp.sec}
        if kind.endswith("Detection3DArray"):
            found["boxes"] = [
                [d.id, d.results[0].hypothesis.class_id, d.bbox.center.position.z, d.bbox.size.x] for d in message.detections
            ]
        elif kind.endswith("DisparityImage"):
            import numpy

            image = message.image
            values = numpy.frombuffer(image.data.tobytes(), numpy.float32).reshape(image.height, image.width)
            found |= {"size": list(values.shape), "max": float(values.max()), "min": float(values.min()), "f": message.f}
        elif kind.endswith("/Image"):
            found |= {"encoding": message.encoding, "size": [message.height, message.width], "bytes": len(message.data)}
        elif kind.endswith("Odometry"):
            found |= {"speed": message.twist.twist.linear.x, "x": message.pose.pose.position.x}
        elif kind.endswith("DiagnosticArray"):
            found |= {"names": [status.name for status in message.status]}
        with lock:
            found["count"] = ros.get(kind, {}).get("count", 0) + 1
            # The fullest is shown: the first may have nothing in it.
            if len(found.get("boxes", [])) < len(ros.get(kind, {}).get("boxes", [])):
                found["boxes"] = ros[kind]["boxes"]
            ros[kind] = found
    except Exception as error:  # noqa: BLE001: each is told
        with lock:
            problems.append(f"{key}: {type(error).__name__}: {error}")


def ask(session):
    for reply in session.get("lookout/*/*/events/**", target=zenoh.QueryTarget.ALL, timeout=5.0):
        if reply.ok is not None:
            take(str(reply.ok.key_expr), reply.ok.payload.to_bytes())


def take_token(sample):
    global appeared
    if sample.kind == zenoh.SampleKind.PUT:
        with lock:
            tokens.add(str(sample.key_expr))
            appeared += 1
        missing.set()


config = zenoh.Config()
config.insert_json5("mode", '"router"')
config.insert_json5("listen/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("transport/shared_memory/enabled", "false")
with zenoh.open(config) as session:
    keep = [
        session.declare_subscriber("lookout/**", lambda s: take(str(s.key_expr), s.payload.to_bytes())),
        session.declare_subscriber("0/**", take_ros),
        session.liveliness().declare_subscriber("lookout/*/*/alive", take_token, history=True),
    ]
    over = threading.Event()

    def fill_gaps():
        while not over.is_set():
            if missing.wait(0.2):
                missing.clear()
                ask(session)

    filler = threading.Thread(target=fill_gaps)
    filler.start()
    print("ready", flush=True)
    for line in sys.stdin:
        # Any line asks for a cloud.
        replies = list(session.get("lookout/*/*/cloud?step=4", timeout=10.0))
        clouds = [[len(r.ok.payload.to_bytes()), r.ok.payload.to_bytes()[:3].decode()] for r in replies if r.ok is not None]
        errors = [r.err.payload.to_string() for r in replies if r.err is not None]
        print(json.dumps({"clouds": clouds, "errors": errors}), flush=True)
    over.set()
    filler.join()
    graph = sorted(str(r.ok.key_expr) for r in session.liveliness().get("@ros2_lv/**", timeout=2.0) if r.ok is not None)
    with lock:
        document = {
            "events": {vehicle: [known[n] for n in sorted(known)] for vehicle, known in events.items()},
            "pictures": {event: sorted(frames) for event, frames in pictures.items()},
            "topics": {name: len(lines) for name, lines in topics.items()},
            "ros": ros,
            "graph": graph,
            "appeared": appeared,
            "problems": problems,
        }
    print(json.dumps(document), flush=True)
