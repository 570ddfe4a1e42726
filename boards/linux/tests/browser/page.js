// Clicks through the page: node page.js JSON. `base` is the page's address, `device` a serial line's name, `modbus` the TCP port to set and
// `reached` the one that clients reach it by, `pid` the gateway's process, `name` what its figures begin with. Pictures go to `folder`.
// With `views` each view is judged at each size and in each colour; `soon`, if it is not 0, is the most milliseconds until the first picture.

const { spawnSync } = require("node:child_process");
const fs = require("node:fs");
const os = require("node:os");
const path = require("node:path");
const { chromium } = require("playwright-core");

const { base, device, modbus, reached, folder, pid, name: prefix, views, soon } = JSON.parse(process.argv[2]);
const AXE = fs.readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];
const VIEWS = ["overview", "devices", "rules", "points", "ethercat", "frames", "log", "network", "users", "settings", "update", "setup"];
// Longest wait for anything, on a busy machine.
const PATIENCE = 60_000;
// Times that the first picture is awaited.
const PICTURES = 7;

const faults = [];
let violations = 0;
/// Nothing responds: connections that end without a response are no fault.
let isCut = false;

function expect(what, well) {
  if (!well) faults.push(what);
  console.log(`${well ? "ok  " : "FAIL"} ${what}`);
}

function figure(name, value, unit, most) {
  const shown = Number.isInteger(value) ? value : value.toFixed(1);
  console.log(`figure ${prefix}${name} ${shown} ${unit} <=${most} ${value <= most ? "ok" : "short"}`);
}

function demand(name, value, unit, most) {
  figure(name, value, unit, most);
  expect(`${name} is at most ${most}`, value <= most);
}

/// A page of a browser that knows nothing; what goes wrong in it is a fault.
async function open(browserContext) {
  const page = await browserContext.newPage();
  page.setDefaultTimeout(PATIENCE);
  page.on("pageerror", (error) => faults.push(`script: ${error.stack}`));
  page.on("console", (message) => {
    // The first question of a page is who has logged in; and what is not possible now, the page says itself.
    const expected = isCut ? /net::ERR_/ : /status of (401|409)/;
    if (message.type() === "error" && !expected.test(message.text())) faults.push(`console: ${message.text()} (${message.location().url})`);
  });
  return page;
}

const shot = (page, name) => page.screenshot({ path: path.join(folder, `${name}.png`), fullPage: true });

async function judge(page, name) {
  await page.evaluate(AXE);
  const { violations: found } = await page.evaluate(() => globalThis.axe.run({ runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"] }));
  for (const { id, nodes } of found) console.log(`FAIL ${name}: ${id}: ${nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  violations += found.length;
}

async function fitsWidth(page, name) {
  const wide = await page.evaluate(() => document.documentElement.scrollWidth > innerWidth);
  expect(`${name} fits its screen`, !wide);
}

async function logIn(page) {
  await page.goto(base);
  await page.getByLabel("User").fill("anna");
  await page.getByLabel("Password").fill("let me in");
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByRole("navigation").waitFor();
}

/// From nothing to devices that clients reach.
async function setUp(context) {
  const page = await open(context);
  await page.goto(base);
  await page.getByLabel("User").waitFor();
  await shot(page, "login-1440");
  await judge(page, "log-in");
  const begin = Date.now();
  await logIn(page);
  // With nothing set up, the wizard is the first view.
  await page.getByLabel("Serial device").fill(device);
  await page.getByRole("button", { name: "Next" }).click();
  await page.getByLabel("Units").fill("1-10");
  await page.getByLabel("19200").uncheck();
  await shot(page, "setup-2");
  await page.getByRole("button", { name: "Scan", exact: true }).click();
  await page.getByRole("button", { name: "Stop" }).waitFor();
  await shot(page, "setup-scan");
  await page.getByRole("button", { name: "Next" }).and(page.locator(":enabled")).click();
  const found = await page.getByRole("region", { name: "Found devices" }).locator("tbody tr").count();
  expect("the scan finds three devices", found === 3);
  await page.getByLabel("TCP port").fill(`${modbus}`);
  await shot(page, "setup-3");
  await page.getByRole("button", { name: "Commit" }).click();
  await page.getByText("The gateway works").waitFor();
  await shot(page, "setup-4");
  demand("page_clicks_s", (Date.now() - begin) / 1000, "s", 60);
  await page.close();
}

/// mbpoll reads what was set up. A device's register holds its unit id, and its address.
function read() {
  for (const unit of [1, 2, 3]) {
    const words = `-m tcp -p ${reached} -a ${unit} -t 4 -r 8 -c 1 -o 5 -1 127.0.0.1`;
    const { status, stdout } = spawnSync("mbpoll", words.split(" "), { encoding: "utf8" });
    expect(`mbpoll reads unit ${unit}`, status === 0 && new RegExp(`\\[8\\]:\\s+${unit * 256 + 7}\\b`).test(stdout));
  }
}

/// Round trips until the picture is there for a user who has logged in: each connection is made for one request, and takes one more.
async function firstPicture(context) {
  const page = await open(context);
  const session = await context.newCDPSession(page);
  await session.send("Network.enable");
  const trips = new Map();
  const requests = [];
  session.on("Network.requestWillBeSent", ({ request, initiator }) => {
    const at = request.url;
    const by = initiator.url || initiator.stack?.callFrames.at(-1)?.url;
    requests.push(at);
    trips.set(at, (at === `${base}/` ? 0 : trips.get(by) ?? 0) + 2);
  });
  let bytes = 0;
  session.on("Network.loadingFinished", ({ encodedDataLength }) => { bytes += encodedDataLength; });
  await page.goto(`${base}/`);
  await page.locator("svg.flow").waitFor();
  const needed = requests.filter((at) => !/events|icon/.test(at));
  console.log(`the first picture takes ${needed.map((at) => at.slice(base.length)).join(" ")}: ${bytes} bytes with all heads`);
  expect("nothing is asked for twice", new Set(needed).size === needed.length);
  demand("page_round_trips", Math.max(...needed.map((at) => trips.get(at))), "round trips", 4);
  await page.close();
  if (soon) figure("first_picture_ms", await soonest(context), "ms", soon);
}

/// Milliseconds from the beginning until the picture is there, as the page's own clock has them; the least of some times, because the
/// machine has other work, too.
async function soonest(context) {
  const times = [];
  for (let nth = 0; nth < PICTURES; nth += 1) {
    const page = await open(context);
    await page.addInitScript(() => {
      const look = () => {
        if (document.querySelector("svg.flow")) globalThis.shownAt = performance.now();
        else requestAnimationFrame(look);
      };
      look();
    });
    await page.goto(`${base}/`);
    times.push(await (await page.waitForFunction(() => globalThis.shownAt)).jsonValue());
    await page.close();
  }
  console.log(`the first picture was there after ${times.map(Math.round).join(", ")} ms`);
  return Math.min(...times);
}

/// Each view, at this size and in these colours.
async function look(browser, state, width, colorScheme) {
  const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme, storageState: state });
  const page = await open(context);
  for (const view of VIEWS) {
    await page.goto(`${base}/#/${view}`);
    await page.locator(`main h1`).waitFor();
    await page.locator(`nav a[href="#/${view}"][aria-current]`).waitFor();
    if (view === "devices") {
      await page.locator("td button.link", { hasText: /^1$/ }).click();
      await page.getByRole("img", { name: /^How long responses took/ }).waitFor();
      await page.locator("td button.link", { hasText: /^77$/ }).click();
      await page.getByRole("img", { name: /^silent: \d+ in the last hour/ }).waitFor();
      await shot(page, `silent-${width}-${colorScheme}`);
      await judge(page, "silent");
      await page.locator("td button.link", { hasText: /^1$/ }).click();
    }
    if (view === "network") await page.getByText("Announced by mDNS").waitFor();
    if (view === "ethercat") await page.getByText("holding 0 count 2 at 0").first().waitFor();
    if (view === "update") await page.getByText("apt install").waitFor();
    if (view === "frames") await page.getByRole("button", { name: "Start" }).click();
    if (view === "rules") {
      await page.getByRole("button", { name: "Try", exact: true }).click();
      await page.getByText(/It is passed on|No rule is for it|It is refused/).waitFor();
    }
    const name = `${view}-${width}-${colorScheme}`;
    await judge(page, name);
    await fitsWidth(page, name);
    await shot(page, name);
  }
  await page.goto(`${base}/#/rules`);
  await page.getByRole("button", { name: "Add a rule" }).click();
  await judge(page, `dialog-${width}-${colorScheme}`);
  await shot(page, `dialog-${width}-${colorScheme}`);
  await context.close();
}

/// Lines, in force at once: a device of a MainDevice, and a unit that is asked in vain.
async function more(context) {
  const page = await open(context);
  await page.goto(base);
  await page.getByRole("navigation").waitFor();
  const responses = await page.evaluate(async () => {
    const line = (await (await fetch("/api/v1/status")).json()).ports.find((port) => port.role === "rtu client").port;
    const call = async (path, kind, body) => (await fetch(`/api/v1/${path}`, { method: "POST", headers: { "Content-Type": kind }, body })).status;
    return [
      await call("settings/candidate", "text/plain", `port fieldbus ethercat interface ecat9 line ${line}\nslave 0 unit 1 holding 0 count 2`),
      await call("settings/commit", "application/json", "{}"),
      await call("ping", "application/json", JSON.stringify({ port: line, unit: 77 })),
    ];
  });
  expect(`a fieldbus and a silent unit: ${responses}`, responses[0] === 200 && responses[1] === 204);
  await page.close();
}

/// A rule below one that takes all its requests is marked in the candidate, and named before the commit.
async function marks(browser, state) {
  const context = await browser.newContext({ storageState: state });
  const page = await open(context);
  await page.goto(`${base}/#/rules`);
  await page.getByRole("button", { name: "Add a rule" }).click();
  await page.getByRole("dialog").getByLabel("Units").fill("2");
  await page.getByRole("button", { name: "Put into the changes" }).click();
  await page.locator("tr.dead", { hasText: "never matches" }).waitFor();
  expect("a rule of the candidate that never matches is marked", true);
  await shot(page, "never-1280");
  await page.getByRole("button", { name: "Review and commit" }).click();
  await page.getByRole("dialog").locator("ul.fault", { hasText: "never" }).waitFor();
  await shot(page, "never-review-1280");
  await judge(page, "never");
  await page.getByRole("button", { name: "Cancel" }).click();
  await page.getByRole("button", { name: "Discard" }).click();
  await page.locator("tr.dead").waitFor({ state: "detached" });
  await context.close();
}

/// The kinds of the blocks in a PCAPNG file; without them all if they do not fill it.
function blocksOf(bytes) {
  const kinds = [];
  let at = 0;
  while (at + 12 <= bytes.length) {
    kinds.push(bytes.readUInt32LE(at));
    at += bytes.readUInt32LE(at + 4);
  }
  return at === bytes.length ? kinds : [];
}

/// Beside four pages that are live, a fifth works, and says how; and frames come.
async function fivePages(browser, state) {
  const context = await browser.newContext({ storageState: state });
  const pages = [];
  for (let nth = 0; nth < 5; nth += 1) {
    const page = await open(context);
    await page.goto(`${base}/#/frames`);
    await page.getByRole("button", { name: "Start" }).waitFor();
    pages.push(page);
  }
  const fifth = pages[4];
  await fifth.getByText("Four other pages are open").waitFor();
  await fifth.getByRole("button", { name: "Start" }).click();
  await fifth.getByText("Waiting for frames.").waitFor();
  spawnSync("mbpoll", `-m tcp -p ${reached} -a 1 -t 4 -r 8 -c 1 -o 5 -1 127.0.0.1`.split(" "));
  await fifth.locator("tbody tr").first().waitFor();
  expect("a fifth page is refreshed, and gets frames", true);
  const [file] = await Promise.all([fifth.waitForEvent("download"), fifth.getByRole("button", { name: "Download" }).click()]);
  const kinds = blocksOf(fs.readFileSync(await file.path()));
  expect(`the download is whole blocks of PCAPNG with packets: ${kinds}`, kinds[0] === 0x0a0d0d0a && kinds.includes(6));
  await shot(fifth, "fifth-1280");
  await judge(fifth, "fifth");
  await pages[0].close();
  await fifth.getByText("Four other pages are open").waitFor({ state: "detached" });
  expect("a place that is free again is taken", true);
  await context.close();
}

/// Presses Tab until what has the focus is named like this.
async function tabTo(page, name) {
  for (let nth = 0; nth < 120; nth += 1) {
    await page.keyboard.press("Tab");
    const focused = await page.evaluate(() => {
      const { activeElement: at } = document;
      return at.getAttribute("aria-label") || at.labels?.[0]?.firstChild?.textContent || at.textContent;
    });
    if (focused.trim() === name) return;
  }
  throw new Error(`Tab does not lead to “${name}”`);
}

/// By keyboard alone: log-in, the order of two rules, commit on trial, and to keep it. Somebody else sees it come.
async function byKeyboard(browser, state) {
  const others = await browser.newContext({ storageState: state });
  const other = await open(others);
  await other.goto(`${base}/#/rules`);
  const context = await browser.newContext();
  const page = await open(context);
  await page.goto(base);
  await page.getByLabel("User").waitFor();
  await tabTo(page, "User");
  await page.keyboard.type("anna");
  await tabTo(page, "Password");
  await page.keyboard.type("let me in");
  await page.keyboard.press("Enter");
  await page.getByRole("navigation").waitFor();
  await tabTo(page, "Rules");
  await page.keyboard.press("Enter");
  await page.getByRole("button", { name: "Add a rule" }).waitFor();
  await tabTo(page, "Add a rule");
  await page.keyboard.press("Enter");
  await tabTo(page, "Units");
  await page.keyboard.press("Control+A");
  await page.keyboard.type("9");
  await tabTo(page, "Put into the changes");
  await page.keyboard.press("Enter");
  await page.getByRole("button", { name: "Move rule 2 up" }).waitFor();
  await tabTo(page, "Move rule 2 up");
  await page.keyboard.press("Enter");
  await page.locator("tbody tr:first-child td:nth-child(3)", { hasText: /^9$/ }).waitFor();
  await other.getByText("There are changes that are not in force yet.").waitFor();
  expect("another page sees the changes", true);
  await shot(page, "changes-1280");
  await judge(page, "changes");
  await tabTo(page, "Review and commit");
  await page.keyboard.press("Enter");
  await page.getByRole("dialog").waitFor();
  await shot(page, "review-1280");
  await judge(page, "review");
  await tabTo(page, "Commit for 5 minutes on trial");
  await page.keyboard.press("Enter");
  await page.getByRole("timer").waitFor();
  const left = await page.getByRole("timer").textContent();
  expect(`the countdown is shown: ${left}`, /^[45]:\d\d$/.test(left));
  await other.getByRole("timer").waitFor();
  await shot(page, "trial-1280");
  await judge(page, "trial");
  await tabTo(page, "Keep the changes");
  await page.keyboard.press("Enter");
  await page.getByRole("timer").waitFor({ state: "detached" });
  await page.locator("tbody tr:first-child td:nth-child(3)", { hasText: /^9$/ }).waitFor();
  expect("the rules are in force in their new order", true);
  await lostAndBack(page);
  await context.close();
  await others.close();
}

/// A gateway that does not respond: the page says so, asks again, and comes back.
async function lostAndBack(page) {
  isCut = true;
  // Not all gateways end their connections: one that has lost its power does not.
  const asked = page.waitForRequest(/\/api\/v1\/events$/);
  process.kill(pid, "SIGSTOP");
  try {
    await page.getByText("The gateway does not respond.").waitFor();
    await asked;
    await shot(page, "lost-1280");
  } finally {
    process.kill(pid, "SIGCONT");
  }
  await page.getByText("live", { exact: true }).waitFor();
  isCut = false;
  expect("a lost connection is said, and comes back", true);
}

async function main() {
  fs.mkdirSync(folder, { recursive: true });
  const profile = fs.mkdtempSync(path.join(os.tmpdir(), "mobgate-browser-"));
  const first = await chromium.launchPersistentContext(profile, { executablePath: "/usr/bin/chromium", args: ARGUMENTS, viewport: { width: 1440, height: 900 } });
  let state;
  try {
    await setUp(first);
    read();
    await firstPicture(first);
    if (views) await more(first);
    state = await first.storageState();
  } finally {
    await first.close();
    fs.rmSync(profile, { recursive: true, force: true });
  }
  const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ARGUMENTS });
  try {
    if (views) for (const width of [360, 1440]) for (const colours of ["light", "dark"]) await look(browser, state, width, colours);
    await marks(browser, state);
    await fivePages(browser, state);
    await byKeyboard(browser, state);
  } finally {
    await browser.close();
  }
  demand("page_axe_violations", violations, "violations", 0);
}

main().catch((error) => faults.push(error.stack)).finally(() => {
  faults.forEach((fault) => console.error(fault));
  process.exitCode = faults.length ? 1 : 0;
});
