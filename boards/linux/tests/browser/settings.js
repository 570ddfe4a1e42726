// What changes the settings: rules, and versions.

const { base, expect, open, shot, judge } = require("./tools.js");

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

module.exports = { marks };
