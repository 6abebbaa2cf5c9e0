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

const ticked = (one) => one.type === "checkbox" || one.type === "radio";
const fieldsOf = (root) => [...root.querySelectorAll("form[data-post] :is(input, select, textarea)")]
  .filter((one) => one.type !== "file" && !one.closest("[data-keep]"));

function changed(one) {
  if (ticked(one)) return one.checked !== one.defaultChecked;
  if (!one.matches("select")) return one.value !== one.defaultValue;
  const first = [...one.options].find((option) => option.defaultSelected) || one.options[0];
  return Boolean(first) && one.value !== first.value;
}

// What was typed, ticked or chosen stays until it is sent; the form may ask that it stays then too.
const unsent = (one) => changed(one) && (!one.form.dataset.sent || one.form.hasAttribute("data-stays"));

function reset(one) {
  if (ticked(one)) one.checked = one.defaultChecked;
  else if (!one.matches("select")) one.value = one.defaultValue;
  else [...one.options].forEach((option) => { option.selected = option.defaultSelected; });
}

// What an element is, whatever it shows: a click on it does the same. Boxes to tick go by their values.
function keyOf(one) {
  if (one.nodeName === "OPTION") return `OPTION ${one.value}`;
  if (one.nodeType !== Node.ELEMENT_NODE || !one.hasAttributes()) return one.nodeName;
  const name = one.getAttribute("name") || "";
  const value = ticked(one) || one.matches("button") ? one.value : "";
  const rest = ["id", "href", "src", "formaction", "aria-labelledby", "data-post", "data-keep", "data-row"];
  return [one.nodeName, ticked(one) ? name.replace(/\d+$/, "") : name, value, ...rest.map((what) => one.getAttribute(what))].join(" ");
}

const PLAIN = new WeakMap();  // tables as the server sent them: headings that sort change them
document.addEventListener("readystatechange", () => {
  if (document.readyState !== "interactive") return;  // before scripts that are deferred
  document.querySelectorAll("#step table").forEach((one) => PLAIN.set(one, one.outerHTML));
});

// Make a part of the page what the server sent, in place: what stays the same keeps its focus, its
// scroll, what was typed, a press that has begun; pictures of the same data stay as they are drawn.
function become(old, next) {
  if (old.nodeType !== Node.ELEMENT_NODE) {
    if (old.data !== next.data) old.data = next.data;
    return;
  }
  if (old.dataset.keep) {
    const place = old.querySelector("[data-motion]"), moved = next.querySelector("[data-motion]");
    if (place && moved) place.dataset.motion = moved.dataset.motion;
    return;
  }
  if (old.isEqualNode(next) || (old.matches("table") && PLAIN.get(old) === next.outerHTML)) return;
  if (old.matches("table")) PLAIN.set(old, next.outerHTML);
  const own = old.dataset.touched ? ["open", "data-touched"] : [];
  for (const { name } of [...old.attributes]) if (!own.includes(name) && !next.hasAttribute(name)) old.removeAttribute(name);
  for (const { name, value } of next.attributes) if (!own.includes(name) && old.getAttribute(name) !== value) old.setAttribute(name, value);
  const left = [...old.childNodes].map((one) => [keyOf(one), one]);
  const pairs = [...next.childNodes].map((child) => {
    const key = keyOf(child), at = left.findIndex(([other]) => other === key);
    return [child, at < 0 ? null : left.splice(at, 1)[0][1]];
  });
  left.forEach(([, one]) => one.remove());
  let place = old.firstChild;
  for (const [child, found] of pairs) {
    if (found && found === place) place = place.nextSibling;
    else old.insertBefore(found || document.adoptNode(child), place);
    if (found) become(found, child);
  }
}

// The page as it is now; `anew` does not wait for an answer that was asked for earlier.
async function refresh(anew = false) {
  if (refreshing && !anew) { again = true; return refreshing; }
  again = false;
  document.body.dataset.busy = "yes";
  const mine = refreshing = (async () => {
    const answer = await fetch(location.pathname).catch(() => null);
    const text = answer && await answer.text();
    if (refreshing !== mine) return;
    if (!answer) say(GONE);
    else if (!answer.ok) say(text);
    else swap(new DOMParser().parseFromString(text, "text/html"));
  })();
  await mine;
  if (refreshing !== mine) return refreshing;
  refreshing = null;
  if (again) return refresh();
  markBusy(false);
}

function swap(page) {
  const untyped = fieldsOf(byId("step")).filter((one) => !unsent(one));
  for (const name of ["steps", "step"]) {
    const fresh = page.getElementById(name);
    if (fresh) become(byId(name), fresh);
  }
  untyped.forEach(reset);
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
  document.querySelectorAll("#step table:not(:has(th .sort))").forEach(makeSortable);
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
  events.onerror = () => say(GONE);  // it tries again by itself
  events.onopen = () => { if (byId("message").textContent === GONE) { say(""); refresh(); } };
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
    form.dataset.sent = "yes";
    await refresh(true);
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
