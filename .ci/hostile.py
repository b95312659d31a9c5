"""A campaign whose names are as hostile as names can be: hostile.py CAMPAIGN_FOLDER NEW_FOLDER

Joints, the target and the robot are renamed to what would break a page that does not escape what it is told.
"""

import html
import json
import pathlib
import sys

JOINTS = {
    "r1_e": "<script>document.title='hacked'</script>",
    "r1_s": "a&b\"c'd<img src=x onerror=alert(1)>",
    "r1_b": "Donaudampfschifffahrtsgesellschaftskapitaenshandgelenkdrehachse" * 2,
}
TARGET = "</h1><b onclick='x()'>\"&amp;" + "W" * 120
ROBOT = "<style>*{display:none}</style>&\"'"


def main():
    old, new = map(pathlib.Path, sys.argv[1:3])
    new.mkdir(parents=True, exist_ok=True)
    robot = (old / "sda5f.urdf").read_text()
    for joint, name in JOINTS.items():
        robot = robot.replace(f'name="{joint}"', f'name="{html.escape(name)}"')
        robot = robot.replace(f'joint="{joint}"', f'joint="{html.escape(name)}"')
    robot = robot.replace('<robot name="sda5f"', f'<robot name="{html.escape(ROBOT)}"')
    (new / "<i>robot & co.urdf").write_text(robot)
    head, rows = (old / "readings.csv").read_text().split("\n", 1)
    columns = head.split(",")
    for joint, name in JOINTS.items():
        whole = {f"{joint}_rad": f"{name}_rad", f"approach_{joint}": f"approach_{name}"}
        columns = [whole.get(column, column) for column in columns]
    quoted = [json.dumps(column).replace('\\"', '""') for column in columns]
    (new / "readings.csv").write_text(",".join(quoted) + "\n" + rows)
    campaign = (old / "campaign.toml").read_text()
    campaign = campaign.replace('robot = "sda5f.urdf"', 'robot = "<i>robot & co.urdf"')
    campaign = campaign.replace('name = "r1"', f"name = {json.dumps(TARGET)}")
    campaign = campaign.replace('{ "r1" =', "{ " + json.dumps(TARGET) + " =")
    (new / "<b>cell & 'co'.toml").write_text(campaign)


if __name__ == "__main__":
    main()
