"""Reads a recording with the mcap package and prints, as JSON, what is in it.

Foxglove's messages are decoded by the descriptors in the file, and, where the package
foxglove_schemas_protobuf is there, once more by the published ones: both must say the same.
"""

import importlib
import json
import struct
import sys

from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

try:
    import foxglove_schemas_protobuf  # noqa: F401

    PUBLISHED = True
except ImportError:
    PUBLISHED = False


def published(name):
    short = name.removeprefix("foxglove.")
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{short}_pb2"), short)


def numbers(descriptor):
    return sorted((f.number, f.name, f.type) for f in descriptor.fields)


def clouds(reader):
    """What points say of themselves: they lie where pixels of the left image do, with their grey levels."""
    images, matrix, found = {}, None, []
    for _, channel, message, decoded in reader.iter_decoded_messages(
        topics=["/left/image", "/left/calibration", "/points"]
    ):
        if channel.topic == "/left/calibration":
            matrix = decoded.K
        elif channel.topic == "/left/image":
            images[message.log_time] = decoded
        else:
            found.append((message.log_time, decoded))
    note = {"clouds": len(found), "points": 0, "on_pixels": 0, "grey": 0, "columns": [], "fields": None}
    columns = set()
    for time, cloud in found:
        image = images.get(time)
        if image is None or image.encoding != "mono8":
            continue
        note["fields"] = [[f.name, f.offset, f.type] for f in cloud.fields]
        for x, y, z, grey in struct.iter_unpack("<4f", cloud.data):
            u, v = x * matrix[0] / z + matrix[2], y * matrix[4] / z + matrix[5]
            column, row = round(u), round(v)
            inside = 0 <= column < image.width and 0 <= row < image.height
            note["points"] += 1
            note["on_pixels"] += inside and abs(u - column) < 0.01 and abs(v - row) < 0.01
            note["grey"] += inside and image.data[row * image.step + column] == grey
            columns.add(column % 2)
    note["columns"] = sorted(columns)
    return note


result = {"topics": {}, "schemas": {}, "metadata": {}, "published": PUBLISHED, "first": {}}
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for schema, channel, message in reader.iter_messages():
        topic = channel.topic
        result["topics"][topic] = result["topics"].get(topic, 0) + 1
        result["schemas"][topic] = f"{schema.name} {schema.encoding}"
        if schema.encoding == "jsonschema":
            json.loads(schema.data)
            document = json.loads(message.data)
            result["first"].setdefault(topic, document)
    file.seek(0)
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for schema, channel, message, decoded in reader.iter_decoded_messages(
        topics=[t for t, s in result["schemas"].items() if s.endswith("protobuf")]
    ):
        if PUBLISHED:
            other = published(schema.name)
            assert numbers(decoded.DESCRIPTOR) == numbers(other.DESCRIPTOR), schema.name
            again = other()
            again.ParseFromString(message.data)
            assert len(UnknownFieldSet(again)) == 0, schema.name
            assert str(again) == str(decoded), schema.name
        note = {}
        for field in ("width", "height", "encoding", "step", "format", "point_stride", "frame_id"):
            if hasattr(decoded, field):
                note[field] = getattr(decoded, field)
        if hasattr(decoded, "data"):
            note["bytes"] = len(decoded.data)
            note["data"] = list(decoded.data[:16])
        if hasattr(decoded, "P"):
            note["P"] = list(decoded.P)
        if hasattr(decoded, "entities"):
            # Obstacles have the numbers of their tracks; free space and boundaries have names.
            note["entities"] = sum(entity.id.isdigit() for entity in decoded.entities)
        if schema.name == "foxglove.ImageAnnotations":
            note["boxes"] = len(decoded.points)
        best = result["first"].get(channel.topic)
        # The one with the most obstacles says most.
        if best is None or note.get("entities", note.get("boxes", 0)) > best.get("entities", best.get("boxes", 0)):
            result["first"][channel.topic] = note
    for record in reader.iter_metadata():
        result["metadata"][record.name] = record.metadata
    if "/points" in result["topics"] and result["schemas"].get("/left/image") == "foxglove.RawImage protobuf":
        file.seek(0)
        result["clouds"] = clouds(make_reader(file, decoder_factories=[DecoderFactory()]))
print(json.dumps(result))
