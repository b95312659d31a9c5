"""Bags by two writers that are not ours, `rosbags` (a rosbag2 folder) and `mcap-ros2-support` (a bare file), of one simulated
cell whose tracker's clock is 3.9 s ahead: `misfit import` must make the same campaign of both.

usage: bag.py MISFIT FOLDER"""

import json
import math
import random
import shutil
import subprocess
import sys
from pathlib import Path

import numpy
from mcap_ros2.writer import Writer as FoxgloveWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

OFFSET = 3.9
START = 1_700_000_000_000_000_000
TYPES = get_typestore(Stores.ROS2_HUMBLE)

URDF = Path(__file__).with_name("three.urdf").read_text()

SPEC = """robot = "three.urdf"
[[target]]
name = "ball"
link = "tip"
tracker = "/tracker/point"
"""


def tip(q):
    """Position of the tip in the base frame, m."""
    reach = 0.6 * math.cos(q[1]) + 0.5 * math.cos(q[1] + q[2])
    height = 0.5 - 0.6 * math.sin(q[1]) - 0.5 * math.sin(q[1] + q[2])
    return [reach * math.cos(q[0]), reach * math.sin(q[0]), height]


def motion():
    """Stops of 2 s, and smooth moves of 1 to 2.5 s between them: (time, joints) at 100 Hz."""
    draw = random.Random(7)
    stops = [[draw.uniform(-1, 1) for _ in range(3)] for _ in range(9)]
    stops += stops[::-1][1:] + stops[1:]
    samples, time = [], 0.0
    for last, to in zip([None] + stops, stops):
        moving = 0.0 if last is None else draw.uniform(1.0, 2.5)
        steps = round((moving + 2.0) * 100)
        for k in range(steps):
            s = min(1.0, k / 100 / moving) if moving else 1.0
            s = s**3 * (10 - 15 * s + 6 * s * s)
            q = [b if last is None else a + (b - a) * s for a, b in zip(last or to, to)]
            samples.append((time + k / 100, q))
        time += steps / 100
    return stops, samples


def messages():
    """(log time in ns, topic, type, fields) in the order of time."""
    noise = random.Random(8).gauss
    stops, samples = motion()
    out = []
    for time, q in samples:
        log = START + round(time * 1e9)
        q = [x + noise(0, 1e-5) for x in q]
        out.append((log, "/joint_states", "sensor_msgs/msg/JointState", (log, ["j3", "j1", "j2"], [q[2], q[0], q[1]])))
        # the tracker stands turned by a quarter about z, 2 m away
        x, y, z = (c + noise(0, 1e-5) for c in tip(q))
        stamp = log + round(OFFSET * 1e9)
        out.append((log + 1000, "/tracker/point", "geometry_msgs/msg/PointStamped", (stamp, [2.0 - y, x, z])))
    return len(stops), out


def split(stamp):
    return divmod(stamp, 1_000_000_000)


def by_rosbags(folder, all_messages):
    kinds = TYPES.types
    header = lambda stamp: kinds["std_msgs/msg/Header"](  # noqa: E731
        stamp=kinds["builtin_interfaces/msg/Time"](*split(stamp)), frame_id="x"
    )
    shutil.rmtree(folder, ignore_errors=True)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for log, topic, kind, fields in all_messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            if kind.endswith("JointState"):
                stamp, names, angles = fields
                empty = numpy.array([], dtype=numpy.float64)
                message = kinds[kind](header(stamp), names, numpy.array(angles), empty, empty)
            else:
                stamp, place = fields
                message = kinds[kind](header(stamp), kinds["geometry_msgs/msg/Point"](*place))
            writer.write(connections[topic], log, TYPES.serialize_cdr(message, kind))


def by_foxglove(path, all_messages):
    with open(path, "wb") as file:
        writer = FoxgloveWriter(file)
        schemas = {}
        for log, topic, kind, fields in all_messages:
            if kind not in schemas:
                text, _ = TYPES.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, text)
            second, nanosecond = split(fields[0])
            header = {"stamp": {"sec": second, "nanosec": nanosecond}, "frame_id": "x"}
            if kind.endswith("JointState"):
                message = {"header": header, "name": fields[1], "position": fields[2], "velocity": [], "effort": []}
            else:
                message = {"header": header, "point": dict(zip("xyz", fields[1]))}
            writer.write_message(topic, schemas[kind], message, log_time=log, publish_time=log)
        writer.finish()


def main(misfit, folder):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "three.urdf").write_text(URDF)
    (folder / "import.toml").write_text(SPEC)
    stops, all_messages = messages()
    by_rosbags(folder / "rosbags", all_messages)
    by_foxglove(folder / "foxglove.mcap", all_messages)
    tables = []
    for bag in ["rosbags", "foxglove.mcap"]:
        cell = folder / f"cell_{bag.split('.')[0]}"
        command = [misfit, "import", str(folder / bag), "--spec", str(folder / "import.toml"), "-o", str(cell), "--json"]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        clock = found["clocks"][0]
        off = clock["offset_s"] - OFFSET
        print(f"{bag}: {found['dwells']['read']} of {stops} stops, clock {clock['offset_s']:.5f} s ({off * 1e3:+.3f} ms)")
        assert found["dwells"]["read"] == stops, found["dwells"]
        assert abs(off) < 1e-3, clock
        tables.append((cell / "readings.csv").read_bytes())
        fit = [misfit, "fit", str(cell / "campaign.toml"), "--effects", "tracker_frame,target_offset", "--json"]
        left = json.loads(subprocess.run(fit, check=True, capture_output=True, text=True).stdout)["fit"]["position_rms_m"]
        print(f"  frames alone leave {left * 1e6:.2f} µm rms")
        assert left < 5e-6, left
    assert tables[0] == tables[1], "the two bags give different readings"
    print("both bags give the same readings")


if __name__ == "__main__":
    main(*sys.argv[1:])
