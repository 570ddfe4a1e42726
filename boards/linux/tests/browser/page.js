// Clicks through the page: node page.js JSON. `base` is the page's address, `device` a serial line's name, `modbus` the TCP port to set and
// `reached` the one that clients reach it by, `pid` the gateway's process, `name` what its figures begin with. Pictures go to `folder`.
// With `views` each view is judged at each size and in each colour; `soon`, if it is not 0, is the most milliseconds until the first picture.

const fs = require("node:fs");
const os = require("node:os");
const path = require("node:path");
const { chromium } = require("playwright-core");

const { fivePages, byKeyboard, users } = require("./people.js");
const { marks, longText, versions, drags } = require("./settings.js");
const { setUp, read, firstPicture } = require("./setup.js");
const { folder, views, found, demand } = require("./tools.js");
const { more, look, filters } = require("./views.js");
const { points, measures, scans, updates } = require("./work.js");

const ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];

async function main() {
  fs.mkdirSync(folder, { recursive: true });
  const profile = fs.mkdtempSync(path.join(os.tmpdir(), "mobgate-browser-"));
  const first = await chromium.launchPersistentContext(profile, { executablePath: "/usr/bin/chromium", args: ARGUMENTS, viewport: { width: 1440, height: 900 } });
  let state;
  try {
    await setUp(first);
    read();
    if (views) await more(first);
    state = await first.storageState();
  } finally {
    await first.close();
    fs.rmSync(profile, { recursive: true, force: true });
  }
  const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ARGUMENTS });
  try {
    await firstPicture(browser, state);
    if (views) for (const width of [360, 1440]) for (const colours of ["light", "dark"]) await look(browser, state, width, colours);
    await marks(browser, state);
    await longText(browser, state);
    await fivePages(browser, state);
    await byKeyboard(browser, state);
    if (views) for (const clicks of [filters, measures, scans, versions, points, drags, updates, users]) await clicks(browser, state);
  } finally {
    await browser.close();
  }
  demand("page_axe_violations", found.violations, "violations", 0);
}

main().catch((error) => found.faults.push(error.stack)).finally(() => {
  found.faults.forEach((fault) => console.error(fault));
  process.exitCode = found.faults.length ? 1 : 0;
});
