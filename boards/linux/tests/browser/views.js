// Each view at the sizes of a phone and a desk, dark and light.

const { base, expect, open, enter, shot, judge, fitsWidth, mbpoll } = require("./tools.js");

const VIEWS = ["overview", "devices", "rules", "points", "ethercat", "frames", "log", "network", "users", "settings", "update", "setup"];

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

/// The filter leaves the frames that have its text, in words or in bytes; also those that come, and when the view is shown again.
async function filters(browser, state) {
  const page = await enter(browser, state, "frames");
  const rows = page.getByRole("region", { name: "Frames" }).locator("tbody tr");
  const filter = page.getByLabel("Filter");
  const of = (unit) => rows.filter({ hasText: `Unit ${unit}:` });
  await page.getByRole("button", { name: "Start" }).click();
  for (const unit of [1, 2]) {
    mbpoll(unit, 7);
    await of(unit).first().waitFor();
  }
  await filter.fill("unit 2");
  await of(1).first().waitFor({ state: "detached" });
  for (const unit of [1, 2]) mbpoll(unit, 8);
  await of(2).filter({ hasText: "Address 8" }).first().waitFor();
  const shown = await rows.count();
  expect(`the filter leaves frames of unit 2: ${shown}`, shown === await of(2).count());
  await filter.fill("02 03 02 02 07");
  await rows.filter({ hasText: "02 03 00 07 00 01" }).first().waitFor({ state: "detached" });
  expect("the filter finds bytes", await rows.count() > 0);
  await page.getByRole("link", { name: "Overview" }).click();
  await page.locator("svg.flow").waitFor();
  await page.getByRole("link", { name: "Frames" }).click();
  await rows.first().waitFor();
  expect("what hides frames is in its field", await filter.inputValue() === "02 03 02 02 07" && await of(1).count() === 0);
  await filter.fill("");
  await of(1).first().waitFor();
  await page.context().close();
}

module.exports = { more, look, filters };
