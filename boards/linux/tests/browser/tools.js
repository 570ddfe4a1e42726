// What the clicks through the page share: what they were told, what they find, and a page to begin with.

const fs = require("node:fs");
const path = require("node:path");
const { spawnSync } = require("node:child_process");

const told = JSON.parse(process.argv[2]);
const { base, reached, folder, name: prefix } = told;
const AXE = fs.readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
// Longest wait for anything, on a busy machine.
const PATIENCE = 60_000;

/// What goes wrong; `isCut`: nothing responds, and connections that end without a response are no fault.
const found = { faults: [], violations: 0, isCut: false };

function expect(what, well) {
  if (!well) found.faults.push(what);
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
  page.on("pageerror", (error) => found.faults.push(`script: ${error.stack}`));
  page.on("console", (message) => {
    // The first question of a page is who has logged in; and what is not possible now, the page says itself.
    const expected = found.isCut ? /net::ERR_/ : /status of (401|403|409|422)/;
    if (message.type() === "error" && !expected.test(message.text())) found.faults.push(`console: ${message.text()} (${message.location().url})`);
  });
  return page;
}

const shot = (page, name) => page.screenshot({ path: path.join(folder, `${name}.png`), fullPage: true });

async function judge(page, name) {
  await page.evaluate(AXE);
  const { violations: broken } = await page.evaluate(() => globalThis.axe.run({ runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"] }));
  for (const { id, nodes } of broken) console.log(`FAIL ${name}: ${id}: ${nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  found.violations += broken.length;
}

async function fitsWidth(page, name) {
  const wide = await page.evaluate(() => document.documentElement.scrollWidth > innerWidth);
  expect(`${name} fits its screen`, !wide);
}

async function logIn(page, user = "anna", password = "let me in") {
  await page.goto(base);
  await page.getByLabel("User").fill(user);
  await page.getByLabel("Password").fill(password);
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByRole("navigation").waitFor();
}

/// A page of the engineer, at this view.
async function enter(browser, state, view) {
  const page = await open(await browser.newContext({ storageState: state }));
  await page.goto(`${base}/#/${view}`);
  return page;
}

/// What the gateway says to the page's user.
const get = async (page, path) => (await page.request.get(`${base}/api/v1/${path}`)).text();

/// Ends the changes by buttons, until their bar is gone.
async function settle(page, ...names) {
  for (const name of names) await page.getByRole("button", { name, exact: true }).click();
  await page.getByRole("region", { name: "Changes" }).waitFor({ state: "detached" });
}

const commit = (page) => settle(page, "Review and commit", "Commit and save");
const discard = (page) => settle(page, "Discard");

/// What mbpoll reads of a device: a holding register, or a coil by type 0.
function mbpoll(unit, address, type = 4) {
  const words = `-m tcp -p ${reached} -a ${unit} -t ${type} -r ${address + 1} -c 1 -o 5 -1 127.0.0.1`;
  const { stdout } = spawnSync("mbpoll", words.split(" "), { encoding: "utf8" });
  return Number(/\[\d+\]:\s+(\d+)/.exec(stdout)?.[1]);
}

module.exports = { ...told, found, expect, figure, demand, open, shot, judge, fitsWidth, logIn, enter, get, commit, discard, mbpoll };
