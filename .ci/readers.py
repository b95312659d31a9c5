"""Decodes every message of recordings with two readers that are not ours.

usage: readers.py FILE.mcap ...   exit code 1 if a reader cannot, if both differ, or if a topic is missing
"""

import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

# on every recording but a map's; what a fit found has the last ones too
CAMPAIGN = {"/robot_description", "/tf", "/tf_static", "/joint_states", "/tracker/pose", "/campaign/reading"}
FOUND = {
    "/prediction/nominal/pose", "/prediction/fitted/pose",
    "/residual/nominal/position", "/residual/fitted/position", "/residual/position_mm",
    "/ladder/rung", "/ladder/cloud", "/ladder/error_mm", "/fit/progress", "/verdict",
}


def plain(value):
    """A message as nested tuples of numbers and texts, whichever reader it came from."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (bytes, bytearray)):
        return tuple(value)
    if isinstance(value, (list, tuple)):
        return tuple(plain(item) for item in value)
    names = getattr(value, "__slots__", None) or getattr(value, "__dataclass_fields__", None)
    if names and not isinstance(value, (int, float, str)):
        return tuple(
            (name.lstrip("_"), plain(getattr(value, name)))
            for name in sorted(names)
            # constants of a type (PointField.FLOAT32) are no part of a message
            if not (name.startswith("__") or name.isupper()) and name.lstrip("_") not in ("type", "full_text", "msgtype")
        )
    return value


def first(path):
    """Messages by topic, with log times, by mcap-ros2-support."""
    topics = {}
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, plain(decoded)))
    return topics


def second(path):
    """The same by rosbags."""
    topics = {}
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            decoded = reader.deserialize(raw, connection.msgtype)
            topics.setdefault(connection.topic, []).append((time, plain(decoded)))
    return topics


def check(path):
    one, other = first(path), second(path)
    counts = {topic: len(messages) for topic, messages in one.items()}
    if counts != {topic: len(messages) for topic, messages in other.items()}:
        return f"{path}: the readers count different messages"
    for topic in one:
        for (time, a), (again, b) in zip(sorted(one[topic], key=str), sorted(other[topic], key=str)):
            if time != again or a != b:
                return f"{path}: {topic} at {time}: the readers differ:\n{str(a)[:300]}\n{str(b)[:300]}"
    is_map = any(topic.startswith("/map/") for topic in one)
    wanted = set() if is_map else CAMPAIGN | (FOUND if "/ladder/rung" in one else set())
    if missing := wanted - set(one):
        return f"{path}: no message on {', '.join(sorted(missing))}"
    print(f"{path}: {sum(counts.values())} messages on {len(counts)} topics, read alike by both")
    return None


def main():
    paths = [Path(name) for name in sys.argv[1:]]
    if not paths:
        sys.exit(__doc__)
    faults = [fault for fault in map(check, paths) if fault]
    sys.exit("\n".join(faults) or 0)


main()
