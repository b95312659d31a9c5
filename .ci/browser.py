"""Opens HTML reports in headless Chromium and looks at them as a reader would.

    browser.py PAGE.html ... [--shots DIR]
    browser.py PAGE.html --picture FILE.png

Each page in light and dark, 400, 700 and 1400 px wide, and on paper. Exit code 1 and a line for each complaint.
"""

import argparse
import base64
import itertools
import json
import pathlib
import sys
import tempfile

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

FLAGS = """--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking
--disable-component-update --disable-sync --hide-scrollbars""".split()
SCHEMES = ["light", "dark"]
WIDTHS = [400, 700, 1400]
PAPER = 720  # about what an A4 sheet's margins leave, px
SECTIONS = "verdict falling carrier parameters correlations blind next origin".split()

# complaints about the page as it stands, a string each
LOOK = r"""
const sections = arguments[0], complaints = [];
const say = text => complaints.push(text);
const name = e => e.tagName.toLowerCase() + (e.id ? '#' + e.id : '') + ' "' + e.textContent.trim().slice(0, 40) + '"';
if (document.documentElement.scrollWidth > innerWidth)
  say(`the page is ${document.documentElement.scrollWidth} px wide in a window of ${innerWidth}`);
for (const id of sections) {
  const section = document.getElementById(id);
  if (!section) say(`section ${id} is missing`);
  else if (section.innerText.trim().length < section.querySelector('h2').innerText.length + 20) say(`section ${id} is empty`);
}
const ids = [...document.querySelectorAll('[id]')].map(e => e.id);
for (const id of new Set(ids)) if (ids.filter(x => x === id).length > 1) say(`id ${id} stands twice`);
for (const a of document.querySelectorAll('a')) {
  const to = a.getAttribute('href') || '';
  if (!to.startsWith('#') || !document.getElementById(to.slice(1))) say(`link ${to} leads nowhere`);
}
for (const e of document.querySelectorAll('[aria-labelledby]'))
  if (!document.getElementById(e.getAttribute('aria-labelledby'))) say(`${name(e)} is labelled by nothing`);
if (document.scripts.length) say('a script');
for (const e of document.querySelectorAll('*'))
  for (const a of e.attributes) if (/^on/i.test(a.name)) say(`${name(e)} has ${a.name}`);

const figures = document.querySelectorAll('figure, svg');
for (const figure of figures) {
  const box = figure.getBoundingClientRect();
  if (box.width < 200 || box.height < 80) say(`${figure.tagName} is ${box.width} x ${box.height} px`);
  if (box.left < 0 || box.right > innerWidth + 0.5) say(`${figure.tagName} reaches from ${box.left} to ${box.right} px`);
}
const boxed = [...document.querySelectorAll('svg')].map(svg => {
  const frame = svg.getBoundingClientRect();
  const marks = svg.querySelectorAll('circle, polyline, path, rect, line');
  if (marks.length < 8) say(`a picture has ${marks.length} marks`);
  const texts = [...svg.querySelectorAll('text')].filter(t => t.textContent.trim());
  if (texts.length < 4) say(`a picture has ${texts.length} words`);
  const boxes = texts.map(t => [t.textContent.trim(), t.getBoundingClientRect()]);
  for (const [text, box] of boxes)
    if (box.left < frame.left - 1 || box.right > frame.right + 1 || box.top < frame.top - 1 || box.bottom > frame.bottom + 1)
      say(`"${text}" is cut off at the edge of its picture`);
  for (let a = 0; a < boxes.length; a++) for (let b = a + 1; b < boxes.length; b++) {
    const [s, p] = boxes[a], [t, q] = boxes[b];
    const wide = Math.min(p.right, q.right) - Math.max(p.left, q.left);
    const high = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    if (wide > 2 && high > 0.35 * Math.min(p.height, q.height)) say(`"${s}" and "${t}" are drawn over each other`);
  }
});
if (!document.querySelector('svg')) say('no picture');

// contrast, as WCAG 2 counts it
const rgb = text => (text.match(/[\d.]+/g) || []).map(Number);
const light = c => {
  const [r, g, b] = c.slice(0, 3).map(x => x / 255).map(x => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const behind = e => {
  for (; e; e = e.parentElement) {
    const c = rgb(getComputedStyle(e).backgroundColor);
    if (c.length === 3 || c[3] > 0.99) return c;
  }
  return [255, 255, 255];
};
const dull = new Set();
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const e = walker.currentNode.parentElement;
  if (!walker.currentNode.data.trim() || !e.checkVisibility() || e.closest('.skip, .hidden')) continue;
  const style = getComputedStyle(e), svg = e.closest('svg');
  const ink = rgb(svg ? style.fill : style.color), paper = behind(svg ? svg.parentElement : e);
  const [a, b] = [light(ink), light(paper)].sort((x, y) => y - x);
  const large = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.66 && style.fontWeight >= 700);
  const ratio = (a + 0.05) / (b + 0.05);
  if (ratio < (large ? 3 : 4.5)) dull.add(`${name(e)} has a contrast of ${ratio.toFixed(1)}`);
}
for (const text of dull) say(text);
return complaints;
"""

# what is folded away is not on paper
UNPRINTED = r"""
return [...document.querySelectorAll('details td, details th')].filter(e => !e.checkVisibility({contentVisibilityAuto: true})).length;
"""


def browser(folder):
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for flag in FLAGS + [f"--user-data-dir={folder}"]:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))


def media(driver, medium, scheme):
    driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"media": medium, "features": [{"name": "prefers-color-scheme", "value": scheme}]},
    )


def size(driver, width):
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False},
    )


def picture(driver, path, height=None):
    whole = driver.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
    if height:
        whole["height"] = height
    shot = driver.execute_cdp_cmd(
        "Page.captureScreenshot",
        {"captureBeyondViewport": True, "clip": {**whole, "scale": 1}},
    )
    path.write_bytes(base64.b64decode(shot["data"]))


def heard(driver, url):
    """What the page said on the console, and what it asked for besides itself."""
    for entry in driver.get_log("browser"):
        yield f"console: {entry['message']}"
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            asked = message["params"]["request"]["url"]
            if asked.split("#")[0] != url and not asked.startswith("data:"):
                yield f"asks for {asked}"


def look(driver, page, shots):
    url = page.resolve().as_uri()
    complaints = []
    for scheme, width in itertools.product(SCHEMES, WIDTHS):
        where = f"{page.name}, {scheme}, {width} px"
        media(driver, "", scheme)
        size(driver, width)
        driver.get("about:blank")
        list(heard(driver, url))
        driver.get(url)
        # folded away is not unseen: as it comes, then with all unfolded
        found = driver.execute_script(LOOK, SECTIONS)
        if shots:
            picture(driver, shots / f"{page.stem}-{scheme}-{width}.png")
        driver.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
        found += [text for text in driver.execute_script(LOOK, SECTIONS) if text not in found]
        found += heard(driver, url)
        complaints += [f"{where}: {text}" for text in found]
    # a dark screen prints on white paper
    media(driver, "print", "dark")
    size(driver, PAPER)
    driver.get(url)
    found = driver.execute_script(LOOK, SECTIONS)
    hidden = driver.execute_script(UNPRINTED)
    if hidden:
        found.append(f"{hidden} cells of tables are folded away")
    if shots:
        picture(driver, shots / f"{page.stem}-paper.png")
        printed = driver.execute_cdp_cmd("Page.printToPDF", {"paperWidth": 8.27, "paperHeight": 11.69})
        (shots / f"{page.stem}.pdf").write_bytes(base64.b64decode(printed["data"]))
    complaints += [f"{page.name}, on paper: {text}" for text in found]
    return complaints


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="+", type=pathlib.Path, metavar="PAGE.html")
    parser.add_argument("--shots", type=pathlib.Path, metavar="DIR", help="keep a picture of each look")
    parser.add_argument("--picture", type=pathlib.Path, metavar="FILE.png", help="only the top of the page, 1000 px wide")
    wanted = parser.parse_args()
    if wanted.shots:
        wanted.shots.mkdir(parents=True, exist_ok=True)
    complaints = []
    with tempfile.TemporaryDirectory() as folder:
        driver = browser(folder)
        try:
            if wanted.picture:
                media(driver, "", "light")
                size(driver, 1000)
                driver.get(wanted.pages[0].resolve().as_uri())
                picture(driver, wanted.picture, 2160)
                return
            for page in wanted.pages:
                found = look(driver, page, wanted.shots)
                print(f"{page.name}: {len(found) or 'no'} complaint{'s' if len(found) != 1 else ''}")
                complaints += found
        finally:
            driver.quit()
    for text in complaints:
        print(text, file=sys.stderr)
    sys.exit(1 if complaints else 0)


if __name__ == "__main__":
    main()
