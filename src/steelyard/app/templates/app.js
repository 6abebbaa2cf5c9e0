"use strict";
document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
// The page of a step: forms, files that are dropped, and changes that the server tells of.
const byId = (name) => document.getElementById(name);
let refreshing = null, again = false;

const GONE = "The app does not answer. Is it still running? Start it again, and open its address: steelyard app";

function say(words, calm = false) {
  byId("message").textContent = words;
  byId("message").classList.toggle("calm", calm);
  if (words) byId("message").scrollIntoView({ block: "nearest" });
}

// What the server said of something that it refused.
function refusal(text, otherwise) {
  try {
    const told = JSON.parse(text);
    return `${told.wrong}\n${told.where}\n${told.fix}`;
  } catch (error) {
    return otherwise;
  }
}

// Send something; what the server refuses is shown, and is `false`.
async function send(address, options) {
  let answer;
  try {
    answer = await fetch(address, options);
  } catch (error) {
    say(GONE);
    return false;
  }
  if (answer.ok) return true;
  const text = await answer.text();
  say(refusal(text, text || `The app failed (${answer.status}).`));
  return false;
}

const post = (address, values) => send(address, {
  method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(values),
});

function valuesOf(form) {
  const found = {};
  for (const [name, value] of new FormData(form)) found[name] = value;
  return found;
}

// A name that a field or button of a form has in the next page too; boxes to tick go by their values.
function nameOf(one) {
  if (!one.form || !one.form.dataset.post) return "";
  const ticked = one.type === "checkbox" || one.type === "radio";
  const own = ticked ? `${one.name.replace(/\d+$/, "")}=${one.value}` : one.name;
  const value = one.matches("button") ? one.value || one.getAttribute("formaction") || "" : "";
  return JSON.stringify([one.form.dataset.post, own, value]);
}

const fieldsOf = (root) => [...root.querySelectorAll("input, select, textarea")]
  .filter((one) => nameOf(one) && one.type !== "file" && !one.closest("[data-keep]"));

function changed(one) {
  if (one.type === "checkbox" || one.type === "radio") return one.checked !== one.defaultChecked;
  if (!one.matches("select")) return one.value !== one.defaultValue;
  const first = [...one.options].find((option) => option.defaultSelected) || one.options[0];
  return Boolean(first) && one.value !== first.value;
}

// What was typed, ticked or chosen and not sent; or sent by a form that the next page shows empty again.
const unsent = () => new Map(fieldsOf(byId("step"))
  .filter((one) => (!one.form.dataset.sent || one.form.hasAttribute("data-stays")) && changed(one))
  .map((one) => [nameOf(one), { value: one.value, checked: one.checked }]));

function retype(values) {
  fieldsOf(byId("step")).forEach((one) => {
    const typed = values.get(nameOf(one));
    if (!typed) return;
    if (one.type === "checkbox" || one.type === "radio") one.checked = typed.checked;
    else if (!one.matches("select")) one.value = typed.value;
    else if ([...one.options].some((option) => option.value === typed.value)) one.value = typed.value;
  });
}

function focused() {
  const one = document.activeElement;
  if (!one || one === document.body) return null;
  const text = one.matches("textarea, input:not([type]), input[type=text]");
  return { id: one.id, name: nameOf(one), marked: text ? [one.selectionStart, one.selectionEnd] : null };
}

function focusAgain(before) {
  if (!before) return;
  const one = (before.id && byId(before.id))
    || (before.name && [...document.querySelectorAll("input, select, textarea, button")].find((x) => nameOf(x) === before.name));
  if (!one || one === document.activeElement) return;
  one.focus({ preventScroll: true });
  if (before.marked) one.setSelectionRange(...before.marked);
}

// The page as it is now. Pictures whose data are the same stay as they are drawn; so do the focus,
// what is unfolded, and what was typed but not sent.
async function refresh() {
  if (refreshing) { again = true; return refreshing; }
  document.body.dataset.busy = "yes";
  refreshing = (async () => {
    const answer = await fetch(location.pathname).catch(() => null);
    if (!answer) say(GONE);
    else if (!answer.ok) say(await answer.text());
    else swap(new DOMParser().parseFromString(await answer.text(), "text/html"));
  })();
  await refreshing;
  refreshing = null;
  if (again) { again = false; return refresh(); }
  markBusy(false);
}

function swap(page) {
  const focus = focused(), typed = unsent();
  const open = new Map([...document.querySelectorAll("details[id][data-touched]")].map((one) => [one.id, one.open]));
  for (const name of ["steps", "step"]) {
    const old = byId(name), fresh = page.getElementById(name);
    if (!fresh) continue;
    const kept = new Map([...old.querySelectorAll("[data-keep]")].map((one) => [one.dataset.keep, one]));
    fresh.querySelectorAll("[data-keep]").forEach((one) => {
      const before = kept.get(one.dataset.keep);
      if (!before) return;
      const fresh = one.querySelector("[data-motion]"), place = before.querySelector("[data-motion]");
      if (fresh && place) place.dataset.motion = fresh.dataset.motion;
      one.replaceWith(before);
    });
    old.replaceWith(document.adoptNode(fresh));
  }
  open.forEach((state, id) => {
    if (byId(id)) { byId(id).open = state; byId(id).dataset.touched = "yes"; }
  });
  retype(typed);
  focusAgain(focus);
  begin();
}

// While something is going on, the page says so.
function markBusy(sending) {
  const busy = sending || refreshing || byId("step").dataset.jobs !== "0";
  if (busy) document.body.dataset.busy = "yes";
  else delete document.body.dataset.busy;
}

function begin() {
  markBusy(false);
  document.querySelectorAll("#step table").forEach((one) => { if (one.dataset.sort) makeSortable(one); });
  // words are painted first, then pictures are drawn
  requestAnimationFrame(() => setTimeout(() => window.dispatchEvent(new Event("content")), 0));
}

function showJobs(jobs) {
  const place = byId("jobs");
  const known = new Map([...place.children].map((one) => [one.dataset.key, one]));
  jobs.forEach((job) => {
    let row = known.get(job.key);
    known.delete(job.key);
    if (!row) {
      row = document.createElement("div");
      row.className = "job";
      row.dataset.key = job.key;
      row.innerHTML = '<span></span><progress max="1"></progress>';
      row.children[1].setAttribute("aria-label", job.words);
      if (job.long) {
        const stop = document.createElement("button");
        stop.className = "button";
        stop.textContent = "Stop";
        stop.addEventListener("click", () => post(`/stop/${job.key}`, {}));
        row.append(stop);
      }
      place.append(row);
    }
    const left = job.left ? `, about ${Math.ceil(job.left)} s left of this part` : "";
    const text = `${job.words}: ${job.phase}${job.note ? ` (${job.note})` : ""}${left}`;
    if (row.children[0].textContent !== text) row.children[0].textContent = text;
    if (job.share === null) row.children[1].removeAttribute("value");
    else row.children[1].value = job.share;
  });
  known.forEach((row) => row.remove());
}

function listen() {
  const events = new EventSource("/events");
  events.onmessage = (event) => {
    const told = JSON.parse(event.data);
    showJobs(told.jobs);
    if (byId("step").dataset.version !== String(told.version)) refresh();
  };
  events.onerror = () => { if (events.readyState === EventSource.CLOSED) refresh(); };
}

document.addEventListener("submit", async (event) => {
  const form = event.target.closest("form[data-post]");
  if (!form) return;
  event.preventDefault();
  say("");
  markBusy(true);
  const values = valuesOf(form);
  if (event.submitter && event.submitter.name) values[event.submitter.name] = event.submitter.value;
  const asked = event.submitter && event.submitter.getAttribute("formaction");
  if (await post(asked || form.dataset.post, values)) {
    document.querySelectorAll("form[data-post]").forEach((one) => {  // a refresh may have replaced it
      if (one.dataset.post === form.dataset.post) one.dataset.sent = "yes";
    });
    await refresh();
  }
  markBusy(false);
});

document.addEventListener("click", (event) => {
  const summary = event.target.closest("summary");
  if (summary) summary.parentElement.dataset.touched = "yes";
});

document.addEventListener("input", (event) => {
  if (event.target.form) delete event.target.form.dataset.sent;
});

document.addEventListener("change", (event) => {
  const one = event.target;
  if (one.matches("[data-now]")) one.form.requestSubmit();
  const drop = one.closest("[data-drop]");
  if (drop && one.type === "file") {
    upload(drop, [...one.files].map((file) => [file.webkitRelativePath || file.name, file]));
  }
});

// With XMLHttpRequest, as fetch tells no progress of what is sent. Why it is refused; empty if it is not.
function put(address, file, progress) {
  return new Promise((done) => {
    const request = new XMLHttpRequest();
    request.open("PUT", address);
    request.upload.addEventListener("progress", (event) => progress(event.loaded));
    request.addEventListener("error", () => done(GONE));
    request.addEventListener("load", () => {
      const failed = `${file.name} was refused (${request.status}).`;
      done(request.status < 300 ? "" : refusal(request.responseText, failed));
    });
    request.send(file);
  });
}

// Whether a file is of a kind that the field takes; hidden files and folders are not.
const belongs = (drop, name) => !/(^|\/)\./.test(name)
  && drop.dataset.kinds.split(" ").some((kind) => name.toLowerCase().endsWith(kind));

const several = (count) => `${count} ${count === 1 ? "file" : "files"}`;

async function upload(drop, files) {
  say("");
  markBusy(true);
  const taken = files.filter(([name]) => belongs(drop, name)), skipped = files.filter(([name]) => !belongs(drop, name));
  const bar = drop.querySelector("progress"), total = taken.reduce((sum, [, file]) => sum + file.size, 0) || 1;
  bar.hidden = false;
  let sent = 0, stored = 0;
  const refused = [];
  for (const [name, file] of taken) {
    const address = drop.dataset.drop + name.split("/").map(encodeURIComponent).join("/");
    const why = await put(address, file, (loaded) => { bar.value = (sent + loaded) / total; });
    if (why) refused.push(why);
    else stored += 1;
    if (why === GONE) break;
    sent += file.size;
  }
  bar.hidden = true;
  drop.querySelectorAll("input").forEach((one) => { one.value = ""; });
  const begun = stored ? await post(drop.dataset.then, {}) : true;
  if (begun && (skipped.length || refused.length)) {
    const names = skipped.slice(0, 5).map(([name]) => name).join(", ") + (skipped.length > 5 ? ", …" : "");
    const left = skipped.length ? [`${skipped.length} skipped: ${names}`] : [];
    const tally = [`${several(stored)} taken`, ...left].join(", ");
    const kinds = `Files that are read here end in ${drop.dataset.kinds.split(" ").join(", ")}.`;
    say([tally, ...(stored || refused.length ? [] : [kinds]), ...refused].join("\n"), stored > 0 && !refused.length);
  }
  refresh();
}

async function filesIn(entry, path) {
  if (entry.isFile) return [[path + entry.name, await new Promise((done, fail) => entry.file(done, fail))]];
  const reader = entry.createReader(), found = [];
  for (;;) {
    const some = await new Promise((done, fail) => reader.readEntries(done, fail));
    if (!some.length) break;
    for (const one of some) found.push(...await filesIn(one, `${path}${entry.name}/`));
  }
  return found;
}

for (const kind of ["dragover", "dragleave", "drop"]) {
  document.addEventListener(kind, async (event) => {
    const drop = event.target.closest && event.target.closest("[data-drop]");
    event.preventDefault();  // a file beside the field does not replace the page
    document.querySelectorAll(".drop.over").forEach((one) => one.classList.remove("over"));
    if (!drop) return;
    if (kind === "dragover") drop.classList.add("over");
    if (kind !== "drop") return;
    const entries = [...event.dataTransfer.items].map((one) => one.webkitGetAsEntry()).filter(Boolean);
    const files = [];
    for (const entry of entries) files.push(...await filesIn(entry, ""));
    upload(drop, files);
  });
}

document.addEventListener("DOMContentLoaded", () => { begin(); listen(); });
