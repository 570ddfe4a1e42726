// What changes the settings: rules, and versions.

const { expect, enter, get, commit, discard, shot, judge, open, logIn } = require("./tools.js");

/// A register and a coil that the gateway polls, the register so often that it is asked as a rule when the page is told.
const POINTS = `port scan scanner
route scan 1 * * P1
device meter unit 1
point limit meter holding 20 read 30ms label "Limit"
point pump meter coil 16
`;

/// A rule below one that takes all its requests is marked in the candidate, and named before the commit.
async function marks(browser, state) {
  const page = await enter(browser, state, "rules");
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
  await discard(page);
  await page.locator("tr.dead").waitFor({ state: "detached" });
  await page.context().close();
}

/// A text that no board takes in one request, but all of it comes, or nothing; and a password that is not shown stays.
async function longText(browser, state) {
  const page = await enter(browser, state, "settings");
  const [inForce, changed] = ["Settings in force", "Settings with the changes"].map((name) => page.getByLabel(name));
  await inForce.waitFor();
  const before = await inForce.inputValue();
  const source = /^route (\S+)/m.exec(before)[1];
  const rules = Array.from({ length: 50 }, (_, nth) => `route ${source} ${nth + 100} * * local addresses 0-${nth + 1}`);
  const wrong = `${before}${[...rules, "route nowhere 1 * * local"].join("\n")}`;
  await inForce.fill(wrong);
  await page.getByRole("button", { name: "Put into the changes" }).click();
  await page.getByText(new RegExp(`^"nowhere": .* \\(line ${wrong.split("\n").length}\\)`)).waitFor();
  expect("a wrong line is named, and leaves no changes", !(await get(page, "settings/candidate")).includes("route"));
  await inForce.fill(before + rules.join("\n"));
  await page.getByRole("button", { name: "Put into the changes" }).click();
  await changed.waitFor();
  const candidate = await get(page, "settings/candidate");
  expect("all lines are in the changes", rules.every((rule) => candidate.replace(/ +/g, " ").includes(rule)));
  await commit(page);
  const again = await browser.newContext();
  await logIn(await open(again));
  await again.close();
  expect("the password is the one from before", true);
  await inForce.fill(before);
  await page.getByRole("button", { name: "Put into the changes" }).click();
  await changed.waitFor();
  await commit(page);
  await page.context().close();
}

/// A commit is a version with its user and time, and the text of before can be brought back.
async function versions(browser, state) {
  const page = await enter(browser, state, "settings");
  // What a click changes is shown by itself, and not only when the view is refreshed.
  await page.addInitScript(() => { globalThis.setInterval = () => 0; });
  await page.reload();
  const [inForce, changed] = ["Settings in force", "Settings with the changes"].map((name) => page.getByLabel(name));
  const saved = page.getByRole("region", { name: "Saved versions" }).locator("tbody tr");
  await saved.first().waitFor();
  const [before, count] = [await inForce.inputValue(), await saved.count()];
  await inForce.fill(before + POINTS);
  await page.getByRole("button", { name: "Put into the changes" }).click();
  await changed.waitFor();
  expect("what was typed is shown as the gateway has it", await changed.inputValue() === await get(page, "settings/candidate"));
  await commit(page);
  await inForce.waitFor();
  await saved.nth(count).waitFor();
  const cells = (await saved.first().locator("td").allTextContents()).slice(0, 4).join(" ");
  expect(`the commit is a version: ${cells}`, /^0 \d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ \+5 -0 anna@127\.0\.0\.1$/.test(cells));
  await inForce.fill("what was typed, and not put into the changes");
  await page.getByRole("button", { name: "Bring back: 1" }).click();
  await changed.waitFor();
  expect("the text of before is shown as the changes", await changed.inputValue() === before);
  expect("the text of before is the candidate", await get(page, "settings/candidate") === before);
  await page.getByRole("button", { name: "Review and commit" }).click();
  const removed = page.getByRole("dialog").locator(".removed");
  await removed.first().waitFor();
  expect("the review says what would go", await removed.count() === 5);
  await page.getByRole("button", { name: "Cancel" }).click();
  await discard(page);
  await inForce.waitFor();
  expect("dropped, it leaves what is in force", (await inForce.inputValue()).includes("point pump"));
  await page.context().close();
}

/// A rule that is dragged by the mouse, while the page is refreshed, changes the order of the candidate.
async function drags(browser, state) {
  const page = await enter(browser, state, "rules");
  const rows = page.getByRole("region", { name: "Rules" }).locator("tbody tr");
  await rows.nth(2).waitFor();
  const order = async () => (await rows.evaluateAll((all) => all.map(({ cells }) => `${cells[1].textContent} ${cells[2].textContent}`))).join(", ");
  const before = await order();
  await rows.nth(2).hover();
  await page.mouse.down();
  await rows.nth(1).hover();
  await page.locator("tr.dragged").waitFor();
  await rows.nth(0).hover();
  await page.mouse.up();
  await rows.nth(0).locator("td", { hasText: /^scan$/ }).waitFor();
  const [first, second, third] = before.split(", ");
  expect(`the dragged rule is the first: ${await order()}`, await order() === [third, first, second].join(", "));
  const candidate = (await get(page, "settings/candidate")).match(/(?<=^route )\S+ +\S+/gm).map((rule) => rule.replace(/ +/, " "));
  expect(`so it is in the candidate: ${candidate}`, candidate.join(", ") === [third, first, second].join(", "));
  await discard(page);
  await page.context().close();
}

module.exports = { marks, longText, versions, drags };
