"""Reads a recording with the mcap package and prints, as JSON, what is in it.

Foxglove's messages are decoded by the descriptors in the file, and, where the package
foxglove_schemas_protobuf is there, once more by the published ones: both must say the same.
"""

import importlib
import json
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
            note["entities"] = len(decoded.entities)
        if schema.name == "foxglove.ImageAnnotations":
            note["boxes"] = len(decoded.points)
        best = result["first"].get(channel.topic)
        # The one with the most obstacles says most.
        if best is None or note.get("entities", note.get("boxes", 0)) > best.get("entities", best.get("boxes", 0)):
            result["first"][channel.topic] = note
    for record in reader.iter_metadata():
        result["metadata"][record.name] = record.metadata
print(json.dumps(result))
