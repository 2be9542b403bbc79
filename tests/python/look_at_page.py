"""Opens a report, or the dashboard of a service, in headless Chromium: no error, no request to elsewhere, text has contrast;
the slider moves the objects, keys work; the dashboard stays live.

Usage: look_at_page.py REPORT.html|URL [FOLDER FOR SCREENSHOTS]
"""

import base64
import json
import pathlib
import re
import subprocess
import sys
import tempfile

import websocket

WIDTHS = [1280, 390]
SCHEMES = ["light", "dark"]

# Text whose contrast with what lies behind it is under 4.5 (WCAG 2.1, 1.4.3), and what reaches over the right edge.
CHECK = """(() => {
  const parse = c => (c.match(/[\\d.]+/g) || []).map(Number);
  const light = c => { const [r, g, b] = c.slice(0, 3).map(v => v / 255).map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const behind = e => { for (; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor);
    if (c.length == 3 || c[3] > 0) return c; } return [255, 255, 255]; };
  const poor = [], wide = [];
  for (const e of document.querySelectorAll("h1,h2,h3,p,li,th,td,span,strong,figcaption,summary,label,output,button,a,code,text")) {
    const own = [...e.childNodes].some(n => n.nodeType == 3 && n.textContent.trim());
    if (!own || !e.getClientRects().length) continue;
    const style = getComputedStyle(e), ink = light(parse(e.tagName == "text" ? style.fill : style.color)), paper = light(behind(e));
    const ratio = (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    if (ratio < 4.5) poor.push(`${e.tagName} ${e.textContent.slice(0, 30)} ${ratio.toFixed(2)}`);
  }
  if (document.documentElement.scrollWidth > innerWidth) wide.push(`${document.documentElement.scrollWidth} > ${innerWidth}`);
  return { poor, wide };
})()"""

BODIES = """[...document.querySelectorAll(".player")].filter(p => p.getClientRects().length).map(p =>
  [...p.querySelectorAll(".body")].map(b => b.getAttribute("transform") + b.style.display))"""


class Browser:
    def __init__(self, folder):
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--remote-debugging-port=0",
                 "--remote-allow-origins=*", f"--user-data-dir={folder}", "--no-first-run", "about:blank"]
        self.process = subprocess.Popen(["chromium", *flags], stderr=subprocess.PIPE, text=True)
        for line in self.process.stderr:
            if found := re.search(r"ws://\S+", line):
                break
        else:
            raise SystemExit("chromium did not start")
        self.socket = websocket.create_connection(found[0], timeout=60)
        self.number, self.session, self.events = 0, None, []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ["Page", "Runtime", "Log", "Network"]:
            self.call(f"{domain}.enable")

    def call(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        self.socket.send(json.dumps(message))
        while True:
            reply = json.loads(self.socket.recv())
            if reply.get("id") == self.number:
                assert "error" not in reply, reply
                return reply["result"]
            self.events.append(reply)

    def value(self, expression):
        reply = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in reply, reply
        return reply["result"].get("value")

    def key(self, key, code):
        for kind in ["keyDown", "keyUp"]:
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def close(self):
        self.process.terminate()
        self.process.wait()


def look(browser, url, width, scheme, shots, try_it):
    browser.events.clear()
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    browser.call("Page.navigate", url=url)
    browser.value("new Promise(r => document.readyState == 'complete' ? r() : addEventListener('load', r))")
    where = f"{width} px, {scheme}"
    found = browser.value(CHECK)
    assert not found["poor"], f"{where}: low contrast: {found['poor']}"
    assert not found["wide"], f"{where}: wider than the window: {found['wide']}"
    try_it(browser, where)
    wrong = [e for e in browser.events if e.get("method") in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")]
    assert not wrong, f"{where}: {wrong}"
    asked = [e["params"]["request"]["url"] for e in browser.events if e.get("method") == "Network.requestWillBeSent"]
    # A picture becomes a PNG by way of an image of its own text.
    assert all(a == url or a.startswith("data:image/svg+xml") for a in asked), f"{where}: requests {asked}"
    if shots:
        height = min(browser.value("document.documentElement.scrollHeight"), 12000)
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)
        picture = browser.call("Page.captureScreenshot", format="png")["data"]
        (shots / f"{try_it.__name__}-{width}-{scheme}.png").write_bytes(base64.b64decode(picture))
    print(f"{where}: good")


def report(browser, where):
    before = browser.value(BODIES)
    assert before and all(before), f"{where}: no player has bodies"
    slide = "document.querySelectorAll('.time').forEach(s => { s.value = s.%s; s.dispatchEvent(new Event('input')) })"
    browser.value(slide % "max")
    before = browser.value(BODIES)
    browser.value(slide % "min")
    after = browser.value(BODIES)
    assert all(a != b for a, b in zip(before, after)), f"{where}: a slider moves nothing"
    browser.value("document.querySelector('.time').focus()")
    for _ in range(5):
        browser.key("ArrowRight", 39)
    assert browser.value("document.querySelector('.time').value") == "5", f"{where}: arrow keys do not move the slider"
    moved = browser.value(BODIES)
    assert moved[0] != after[0], f"{where}: arrow keys move nothing"
    browser.value("document.querySelector('.play').click()")
    browser.value("new Promise(r => setTimeout(r, 500))")
    assert int(browser.value("document.querySelector('.time').value")) > 5, f"{where}: play does not play"
    browser.value("document.querySelector('.play').click()")
    worst = browser.value("""(() => { const p = [...document.querySelectorAll('.player')].find(p => p.querySelector('.worst'));
      if (!p) return true;
      p.querySelector('.worst').click();
      return +p.querySelector('.time').value == JSON.parse(p.querySelector('.motion').textContent).start; })()""")
    assert worst, f"{where}: the farthest frame is not shown"
    picked = browser.value("""(() => { const c = document.querySelector('.choose'); if (!c) return true;
      c.value = '1'; c.dispatchEvent(new Event('change'));
      const shown = [...document.querySelectorAll('.video')].map(v => !v.hidden);
      c.value = '0'; c.dispatchEvent(new Event('change'));
      return shown.indexOf(true) == 1 && shown.lastIndexOf(true) == 1; })()""")
    assert picked, f"{where}: choosing a video does not show it"


    tools(browser, where)


def tools(browser, where):
    """Zoom, values under the pointer, and files."""
    zoomed = browser.value("""(() => { const f = document.querySelector('figure[data-name=residual-time-1]'), svg = f.querySelector('svg');
      const press = (text) => [...f.querySelectorAll('.tools button')].find(b => b.textContent == text).click();
      const whole = svg.getAttribute('viewBox'); press('+'); const near = svg.getAttribute('viewBox'); press('1:1');
      return near != whole && svg.getAttribute('viewBox') == whole; })()""")
    assert zoomed, f"{where}: zoom does not zoom"
    shown = browser.value("""(() => { const f = document.querySelector('figure[data-name=residual-time-1]'), svg = f.querySelector('svg');
      f.scrollIntoView({ block: 'center' });
      const row = JSON.parse(f.querySelector('.data').textContent).series[0].rows[5], m = svg.getScreenCTM();
      const at = new DOMPoint(row.at(-2), row.at(-1)).matrixTransform(m);
      svg.dispatchEvent(new PointerEvent('pointermove', { clientX: at.x, clientY: at.y, bubbles: true }));
      const tip = f.querySelector('.tip'), text = tip.hidden ? '' : tip.textContent;
      svg.dispatchEvent(new PointerEvent('pointerleave'));
      scrollTo(0, 0);
      return text; })()""")
    assert "time (s)" in shown and "residual (mm)" in shown, f"{where}: no value under the pointer: {shown}"
    kept = browser.value("""(async () => { const kept = [], make = URL.createObjectURL, click = HTMLAnchorElement.prototype.click;
      URL.createObjectURL = (blob) => { kept.push(blob); return make.call(URL, blob); };
      HTMLAnchorElement.prototype.click = () => {};
      const f = document.querySelector('figure[data-name=residual-time-1]');
      for (const b of f.querySelectorAll('.tools button')) if (['CSV', 'SVG', 'PNG'].includes(b.textContent)) b.click();
      document.querySelector('.numbers > button').click();
      for (let k = 0; k < 50 && kept.length < 4; k++) await new Promise(r => setTimeout(r, 100));
      URL.createObjectURL = make; HTMLAnchorElement.prototype.click = click;
      return Promise.all(kept.map(async (b) => b.type + ' ' + (await b.slice(0, 60).text()))); })()""")
    assert len(kept) == 4, f"{where}: saved {kept}"
    for start in ["text/csv series,time (s),residual (mm)", "image/svg+xml <svg", "image/png ", "text/csv parameter,value,sd,low95,high95"]:
        assert any(k.startswith(start) for k in kept), f"{where}: {start} is not in {kept}"


def dashboard(browser, where):
    browser.value("new Promise(r => setTimeout(r, 2500))")
    assert browser.value("document.getElementById('fresh').textContent") == "live", f"{where}: it is not live"
    links = browser.value("document.querySelectorAll('td a, th a').length")
    assert links > 1, f"{where}: nothing leads to a report or a trace"


def main():
    service = sys.argv[1].startswith("http")
    url = sys.argv[1].rstrip("/") + "/" if service else pathlib.Path(sys.argv[1]).resolve().as_uri()
    shots = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None
    if shots:
        shots.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(folder)
        try:
            for width in WIDTHS:
                for scheme in SCHEMES:
                    look(browser, url, width, scheme, shots, dashboard if service else report)
        finally:
            browser.close()


main()
