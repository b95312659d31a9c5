"""First inputs of the fuzz targets, made of files of the repository: seeds.py FOLDER

Recordings come in pieces, without checksums and unpacked, so that a change of one byte is still read; a few are packed.
"""

import csv
import re
import sys
from pathlib import Path

from bag import by_foxglove, messages
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory

MOST = 60  # messages of a piece
FORMS = {
    "plain": {"use_chunking": False},
    "chunks": {"compression": CompressionType.NONE, "chunk_size": 4096},
    "lz4": {"compression": CompressionType.LZ4},
    "zstd": {"compression": CompressionType.ZSTD},
}


def piece(source, target, form, most=MOST, every=1):
    """The first messages of a recording with its attachments and metadata, written in another form."""
    with open(source, "rb") as stream, open(target, "wb") as out:
        reader = make_reader(stream)
        writer = Writer(out, index_types=IndexType.NONE, enable_crcs=False, enable_data_crcs=False, **FORMS[form])
        writer.start(profile="ros2", library="")
        schemas, channels = {}, {}
        for place, (schema, channel, message) in enumerate(reader.iter_messages()):
            if place >= most:
                break
            if place % every:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        for one in reader.iter_attachments():
            writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        for one in reader.iter_metadata():
            writer.add_metadata(one.name, one.metadata)
        writer.finish()


def table(source, target):
    """Readings of a recording as a table."""
    rows = {}
    with open(source, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        topics = ["/campaign/reading", "/joint_states", "/tracker/pose", "/wrist_ft/wrench"]
        for _, channel, message, found in reader.iter_decoded_messages(topics):
            row = rows.setdefault(message.log_time, {})
            if channel.topic == topics[0]:
                row["target"] = found.target
                row["time_s"] = found.time[0] if found.time else ""
                row["payload_kg"] = found.payload[0] if found.payload else ""
            elif channel.topic == topics[1]:
                row.update({f"{name}_rad": angle for name, angle in zip(found.name, found.position)})
            elif channel.topic == topics[2]:
                place, turn = found.pose.position, found.pose.orientation
                row.update({f"{axis}_m": getattr(place, axis) for axis in "xyz"})
                row.update({f"q{axis}": getattr(turn, axis) for axis in "wxyz"})
            else:
                force, torque = found.wrench.force, found.wrench.torque
                row.update({f"f{axis}_N": getattr(force, axis) for axis in "xyz"})
                row.update({f"t{axis}_Nm": getattr(torque, axis) for axis in "xyz"})
    rows = list(rows.values())[:8]
    with open(target, "w", newline="") as out:
        writer = csv.DictWriter(out, fieldnames=list(max(rows, key=len)), restval="")
        writer.writeheader()
        writer.writerows(rows)


def main(folder):
    folder = Path(folder)
    place = {}
    for name in ["campaign_toml", "campaign_csv", "urdf", "dh", "scenario", "model", "formula", "recording", "bag"]:
        place[name] = folder / name
        place[name].mkdir(parents=True, exist_ok=True)
    recordings = sorted(Path("recordings").glob("*.mcap"))
    for path in recordings:
        for form in FORMS:
            piece(path, place["recording"] / f"{path.stem}.{form}", form)
        with open(path, "rb") as stream:
            for one in make_reader(stream).iter_attachments():
                if one.name == "campaign.toml":
                    text = one.data.decode().replace("\n", '\ntable = "readings.csv"\n', 1)
                    (place["campaign_toml"] / f"{path.stem}.toml").write_text(text)
    table("recordings/hidden.mcap", place["campaign_csv"] / "hidden.csv")
    (place["campaign_csv"] / "tasks.csv").write_bytes(Path("recordings/tasks.csv").read_bytes())
    for path in [*Path("models").rglob("*.urdf"), Path(".ci/three.urdf")]:
        (place["urdf"] / path.name).write_bytes(path.read_bytes())
    for path in Path("models").rglob("*_dh.toml"):
        (place["dh"] / path.name).write_bytes(path.read_bytes())
    for path in Path("crates/misfit-core/src/effects").glob("*.rs"):
        (place["model"] / f"{path.stem}.toml").write_text(f'[[effect]]\nkind = "{path.stem}"\nhold = true\n')
    formulas = set()
    for path in [*Path("scenarios").rglob("*.toml"), *Path("tests").glob("*.rs")]:
        text = path.read_text()
        if path.suffix == ".toml":
            (place["scenario"] / path.name).write_text(text)
            effects = re.findall(r"^\[\[(?:truth|effect)\]\]\n(?:[^\[\n].*\n)*", text, re.M)
            for number, one in enumerate(effects):
                # presets and random draws are for truths alone
                one = re.sub(r"(?m)^(preset|random|exponent) .*\n", "", one.replace("[[truth]]", "[[effect]]"))
                (place["model"] / f"{path.stem}.{number}.toml").write_text(one)
        formulas.update(re.findall(r'law *= *\\?"([^"\\]+)', text))
        if path.name == "formula.rs":
            formulas.update(re.findall(r'"([^"\\]{3,60})"', text))
    for number, one in enumerate(sorted(formulas)):
        (place["formula"] / f"{number}").write_text(one)
    bag = folder / "whole.mcap"
    by_foxglove(bag, messages()[1])
    for form in FORMS:
        # ten samples a second of the first stops
        piece(bag, place["bag"] / f"stops.{form}", form, most=8000, every=21)
        piece(recordings[0], place["bag"] / f"{recordings[0].stem}.{form}", form)
    bag.unlink()


if __name__ == "__main__":
    main(sys.argv[1])
