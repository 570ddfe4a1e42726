// What the gateway asks and writes on command: points, scan, tune, and updates.

const http = require("node:http");

const { base, expect, open, enter, get, discard, shot, judge, mbpoll } = require("./tools.js");

/// Writes by the point's dialog.
async function write(page, name, value) {
  await page.getByRole("button", { name: `Write ${name}` }).click();
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("Values").fill(value);
  await dialog.getByRole("button", { name: "Write now" }).click();
  await page.getByRole("status").getByText(name).waitFor();
}

/// Points with value, age and quality; what is written is in the device, and not before it is confirmed.
async function points(browser, state) {
  const page = await enter(browser, state, "points");
  const row = (name) => page.getByRole("region", { name: "Points" }).locator("tbody tr", { hasText: name });
  const cell = (name, nth) => row(name).locator("td").nth(nth);
  for (const [name, value] of [["limit", "276"], ["pump", "1"]]) {
    await cell(name, 2).getByText(value, { exact: true }).waitFor();
    const told = (await row(name).locator("td").allTextContents()).join(" | ");
    expect(`value, age and quality: ${told}`, /^\d(\.\d)? s$/.test(await cell(name, 4).textContent()) && await row(name).locator(".lamp.up", { hasText: "ok" }).count() === 1);
  }
  await row("limit").locator(".lamp.up", { hasText: "busy" }).waitFor();
  await page.getByRole("img", { name: "limit: between 276 and 276" }).waitFor();
  await page.getByRole("button", { name: "Write limit" }).click();
  await page.getByRole("dialog").getByText("The values are sent to meter at once.").waitFor();
  await page.getByRole("dialog").getByLabel("Values").fill("4711");
  await judge(page, "write");
  await shot(page, "write-1280");
  await page.getByRole("button", { name: "Cancel" }).click();
  expect("nothing is written without a confirmation", mbpoll(1, 20) === 276);
  await write(page, "limit", "4711");
  expect("the register is written", mbpoll(1, 20) === 4711);
  await cell("limit", 2).getByText("4711", { exact: true }).waitFor();
  await page.getByRole("img", { name: "limit: between 276 and 4711" }).waitFor();
  await write(page, "pump", "0");
  expect("the coil is written", mbpoll(1, 16, 0) === 0);
  await page.getByRole("button", { name: "Write limit" }).click();
  await page.getByRole("dialog").getByLabel("Values").fill("70000");
  await page.getByRole("button", { name: "Write now" }).click();
  const refusal = await page.locator(".notice.bad").textContent();
  expect(`a value that does not fit is refused: ${refusal}`, /70000/.test(refusal) && mbpoll(1, 20) === 4711);
  await judge(page, "points");
  await shot(page, "points-1280");
  await page.context().close();
}

const card = (page, name) => page.locator("section.card", { has: page.getByRole("heading", { name }) });

/// A measurement tells how far it is, is stopped without a proposal, and proposes a time-out at its end.
async function measures(browser, state) {
  const page = await enter(browser, state, "devices");
  const own = card(page, "Measure response times");
  await own.getByLabel("Requests for each unit").fill("20000");
  await own.getByRole("button", { name: "Measure" }).click();
  await own.getByRole("progressbar").waitFor();
  await own.locator("p", { hasText: /unit 1: \d+ of 20000, about \d+[sm] left/ }).waitFor();
  await own.getByRole("button", { name: "Stop" }).click();
  await own.locator("p", { hasText: "stopped: too little is known to propose anything" }).waitFor();
  expect("stopped, it proposes nothing", await own.getByRole("button", { name: "Take over" }).count() === 0);
  await own.getByLabel("Requests for each unit").fill("10");
  await own.getByRole("button", { name: "Measure" }).click();
  await own.getByRole("button", { name: "Take over" }).click();
  await page.getByRole("button", { name: "Review and commit" }).click();
  const lines = page.getByRole("dialog").locator(".added");
  await lines.first().waitFor();
  const added = await lines.allTextContents();
  const port = (await get(page, "settings/candidate")).match(/^port P1 .*$/m)[0];
  expect(`its result is in the candidate: ${port}`, / timeout [0-9.]+ms/.test(port) && added.length === 1 && added[0].trim() === `+ ${port}`);
  await page.getByRole("button", { name: "Cancel" }).click();
  await discard(page);
  await page.context().close();
}

/// A scan that is stopped keeps what it has found, and the line works as before.
async function scans(browser, state) {
  const page = await enter(browser, state, "devices");
  const own = card(page, "Find devices");
  const rows = page.getByRole("region", { name: "Found devices" }).locator("tbody tr");
  await own.getByLabel("Units").fill("1-247");
  await own.getByRole("button", { name: "Scan", exact: true }).click();
  await rows.first().waitFor();
  await own.getByRole("button", { name: "Stop" }).click();
  await own.getByRole("button", { name: "Take over" }).waitFor();
  const kept = await rows.allTextContents();
  expect(`a scan that is stopped keeps what it has found: ${kept}`, kept.length > 0 && /^1/.test(kept[0]));
  await own.getByText("Everything it said").click();
  const said = await own.locator("pre").textContent();
  expect("it has not asked all", !/^\S+ 8N2 /m.test(said));
  expect("the line works again", mbpoll(1, 7) === 263);
  await shot(page, "scan-stopped-1280");
  await page.context().close();
}

/// A board that takes updates, played in front of the gateway, which has all other paths: the emulated boards have either a network or
/// updates. `hears` is called with each request for `/api/v1/update`, and its response.
function boardBefore(hears) {
  const { host, hostname, port } = new URL(base);
  return http.createServer((request, response) => {
    if (request.url === "/api/v1/update") return hears(request, response);
    const headers = { ...request.headers, host };
    if (headers.origin) headers.origin = base;
    const behind = http.request({ hostname, port, path: request.url, method: request.method, headers }, (from) => {
      response.writeHead(from.statusCode, from.headers);
      from.pipe(response);
    });
    // Events do not end before the page.
    behind.on("error", () => response.destroy());
    response.on("close", () => behind.destroy());
    return request.pipe(behind);
  });
}

/// New firmware is sent with progress, refused, and taken back.
async function updates(browser, state) {
  const seen = { resume: null, respond: null, bytes: 0, wentBack: false };
  const json = (response, status, body) => response.writeHead(status, { "Content-Type": "application/json" }).end(JSON.stringify(body));
  const board = boardBefore((request, response) => {
    if (request.method === "GET") return json(response, 200, { version: "0.1.0", board: "NUCLEO-H743ZI", state: "on trial" });
    if (request.method === "DELETE") {
      seen.wentBack = true;
      return response.writeHead(204).end();
    }
    seen.bytes = 0;
    seen.respond = (status, body) => json(response, status, body);
    // The rest is read when the page has said how far it is.
    request.once("readable", () => { seen.resume = () => request.on("data", (piece) => { seen.bytes += piece.length; }); });
  });
  await new Promise((resolve) => { board.listen(0, "127.0.0.1", resolve); });
  const page = await open(await browser.newContext({ storageState: state }));
  await page.goto(`http://127.0.0.1:${board.address().port}/#/update`);
  const [send, progress] = [page.getByRole("button", { name: "Send and restart" }), page.getByRole("progressbar", { name: "Sent" })];
  // More than the sockets between hold.
  const image = { name: "firmware.mgu", mimeType: "application/octet-stream", buffer: Buffer.alloc(32 << 20, 7) };
  const begin = async () => {
    seen.resume = null;
    await page.getByLabel("File").setInputFiles(image);
    await send.click();
    await page.getByRole("status").getByText(/^ [1-9]\d? %$/).waitFor();
    expect("nothing else is sent meanwhile", await send.isDisabled());
    await judge(page, "update");
    await shot(page, "update-1280");
    while (!seen.resume) await page.waitForTimeout(10);
    seen.resume();
    await page.getByText("It is checked.").waitFor();
  };
  await begin();
  seen.respond(200, { version: "0.2.0" });
  await page.getByText("0.2.0 is complete and genuine").waitFor();
  expect(`the file was sent: ${seen.bytes} bytes`, seen.bytes === image.buffer.length);
  await begin();
  seen.respond(422, { error: { message: "the signature is wrong" } });
  await page.getByText("the signature is wrong").waitFor();
  await progress.waitFor({ state: "detached" });
  await page.getByRole("button", { name: "Take back what is on trial" }).click();
  await page.getByText("The firmware from before starts now.").waitFor();
  expect("the board was told to go back", seen.wentBack);
  await page.context().close();
  board.closeAllConnections();
  board.close();
}

module.exports = { write, points, measures, scans, updates };
