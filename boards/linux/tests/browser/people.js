// Several people at once, and one who has a keyboard alone.

const fs = require("node:fs");

const { base, pid, found, expect, open, logIn, enter, get, commit, shot, judge, mbpoll } = require("./tools.js");
const { write } = require("./work.js");

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
  mbpoll(1, 7);
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
  found.isCut = true;
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
  found.isCut = false;
  expect("a lost connection is said, and comes back", true);
}

/// What shows that a view has what it asks the gateway for, if that is no table.
const LOADED = { overview: "svg.flow", frames: "p.empty", settings: "textarea" };

/// The buttons of each view that has some, without those that open a unit.
async function buttons(page) {
  const views = await page.getByRole("navigation").getByRole("link").evaluateAll((links) => links.map((link) => link.hash.slice(2)));
  const all = [];
  for (const view of views) {
    await page.goto(`${base}/#/${view}`);
    await page.locator(`nav a[href="#/${view}"][aria-current]`).waitFor();
    await page.locator(`main ${LOADED[view] || "table"}`).first().waitFor();
    const names = await page.locator("main button:not(.link)").evaluateAll((found) => found.map((button) => button.getAttribute("aria-label") || button.textContent));
    if (names.length) all.push(`${view}: ${names.join(", ")}`);
  }
  return all.join("; ");
}

async function addUser(page, name, role, password) {
  await page.getByLabel("Name").fill(name);
  await page.getByLabel("Role").selectOption(role);
  await page.getByRole("button", { name: "Add", exact: true }).click();
  await commit(page);
  await page.getByRole("button", { name: `Set password: ${name}` }).click();
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("New password").fill(password);
  await dialog.getByLabel("Again").fill("something else");
  await dialog.getByRole("button", { name: "Set and save" }).click();
  await dialog.getByText("The two differ.").waitFor();
  await dialog.getByLabel("Again").fill(password);
  await dialog.getByRole("button", { name: "Set and save" }).click();
  await page.getByText(`${name} has the new password.`).waitFor();
}

/// Users come, may do what their role may, and go.
async function users(browser, state) {
  const page = await enter(browser, state, "users");
  const pages = {};
  for (const [name, role] of [["bert", "viewer"], ["olga", "operator"]]) {
    await addUser(page, name, role, `I am ${name}`);
    pages[role] = await open(await browser.newContext());
    await logIn(pages[role], name, `I am ${name}`);
  }
  const { viewer, operator } = pages;
  const seen = [await buttons(viewer), await buttons(operator)];
  expect(`a viewer may look: ${seen[0]}`, seen[0] === "rules: Try; frames: Start, Download (PCAPNG)");
  expect(`an operator may write: ${seen[1]}`, seen[1] === "rules: Try; points: Write limit, Write pump; frames: Start, Download (PCAPNG)");
  await operator.goto(`${base}/#/points`);
  await write(operator, "pump", "1");
  expect("what an operator writes is in the device", mbpoll(1, 16, 0) === 1);
  await page.getByRole("button", { name: "Remove user bert" }).click();
  await page.getByRole("dialog").getByRole("button", { name: "Remove user" }).click();
  await viewer.getByText("There are changes that are not in force yet.").waitFor();
  const meanwhile = await buttons(viewer);
  expect(`a viewer sees changes, and may not commit them: ${meanwhile}`, meanwhile === seen[0]);
  await commit(page);
  await page.getByRole("row", { name: "bert" }).waitFor({ state: "detached" });
  await viewer.getByLabel("User").waitFor();
  expect("a user who is deleted is out", !(await get(page, "users")).includes("bert"));
  // Another role, which her page learns when it is refused something.
  await page.getByLabel("Name").fill("olga");
  await page.getByLabel("Role").selectOption("viewer");
  await page.getByRole("button", { name: "Add", exact: true }).click();
  await commit(page);
  const button = operator.getByRole("button", { name: "Write pump" });
  await button.click();
  await operator.getByRole("dialog").getByLabel("Values").fill("0");
  await operator.getByRole("dialog").getByRole("button", { name: "Write now" }).click();
  await operator.getByText("needs the role operator; yours is viewer").waitFor();
  await button.waitFor({ state: "detached" });
  expect("what a viewer writes is not in the device", mbpoll(1, 16, 0) === 1);
  for (const one of [page, viewer, operator]) await one.context().close();
}

module.exports = { fivePages, byKeyboard, users };
