// From a gateway with nothing but one user to devices that clients reach, and the first picture.

const { base, device, modbus, soon, expect, figure, demand, open, shot, judge, logIn, mbpoll } = require("./tools.js");

// Times that the first picture is awaited.
const PICTURES = 7;

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
  // The lines that the gateway has are offered; a PTY is none.
  const [lines, isBoard] = [page.locator("datalist option"), !device.startsWith("/")];
  await page.getByLabel("Serial device").waitFor();
  const offered = await lines.evaluateAll((all) => all.map(({ value }) => value));
  expect(`the serial lines are offered: ${offered}`, isBoard ? offered.includes(device) : offered.every((line) => line.startsWith("/dev/")));
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
  for (const unit of [1, 2, 3]) expect(`mbpoll reads unit ${unit}`, mbpoll(unit, 7) === unit * 256 + 7);
}

/// Round trips until the picture is there for a user who has logged in, in a browser that has nothing of the page yet: each connection is
/// made for one request, and takes one more.
async function firstPicture(browser, state) {
  const context = await browser.newContext({ storageState: state });
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
  await context.close();
  if (soon) figure("first_picture_ms", await soonest(browser, state), "ms", soon);
}

/// Milliseconds from the beginning until the picture is there, as the page's own clock has them; the least of some times, because the
/// machine has other work, too.
async function soonest(browser, state) {
  const times = [];
  for (let nth = 0; nth < PICTURES; nth += 1) {
    // Without what the time before has left in the cache.
    const context = await browser.newContext({ storageState: state });
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
    await context.close();
  }
  console.log(`the first picture was there after ${times.map(Math.round).join(", ")} ms`);
  return Math.min(...times);
}

module.exports = { setUp, read, firstPicture };
