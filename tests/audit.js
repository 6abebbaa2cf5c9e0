// Checks of a page, called in it by tests: each returns what is wrong, empty if nothing is.

// Resolves when every picture that is not in a closed part has been drawn as wide as its place, or
// the page has an error.
async function drawn() {
  const frames = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const waiting = () => [...document.querySelectorAll(".plot, .picture")].some((one) => {
    const current = one.dataset.run !== undefined || one.dataset.drawn !== undefined;
    const figure = current && one.querySelector(".main-svg");
    return one.checkVisibility() && !(figure && Math.abs(figure.clientWidth - one.clientWidth) < 2);
  });
  await frames();
  for (let k = 0; k < 400 && waiting() && !document.body.dataset.errors; k += 1) await new Promise((done) => setTimeout(done, 25));
  await document.fonts.ready;
  await frames();
}

function named(element) {
  const kind = element.tagName.toLowerCase() + (element.id ? "#" + element.id : "");
  const words = (element.textContent || element.getAttribute("aria-label") || "").trim();
  return `${kind}.${[...element.classList].join(".")} '${words.slice(0, 40)}'`;
}

// Elements that stick out of the window, if the page can be scrolled sideways.
function overflow() {
  const width = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth <= width && window.innerWidth <= width) return [];
  const out = [...document.body.querySelectorAll("*")].filter((one) =>
    one.getBoundingClientRect().right > width + 0.5 && one.checkVisibility());
  return [`the page is ${document.documentElement.scrollWidth} px wide, the window ${width} px`,
    ...out.slice(0, 5).map(named)];
}

// Figures that are not as large as their place, which cuts what does not fit.
function cut() {
  return [...document.querySelectorAll(".plot, .picture")].filter((one) => {
    const figure = one.checkVisibility() && one.querySelector(".main-svg");
    return figure && (Math.abs(figure.clientWidth - one.clientWidth) > 1
      || Math.abs(figure.clientHeight - one.clientHeight) > 1);
  }).map((one) => `${named(one)} is ${one.clientWidth} px wide, its figure ${one.querySelector(".main-svg").clientWidth} px`);
}

function channels(colour) {
  const found = colour.match(/^rgba?\(([^)]*)\)$/);
  if (!found) return null;
  const values = found[1].split(/[\s,/]+/).map(Number);
  return { rgb: values.slice(0, 3), alpha: values.length > 3 ? values[3] : 1 };
}

function over(top, alpha, below) {
  return top.map((value, k) => alpha * value + (1 - alpha) * below[k]);
}

function luminance(rgb) {
  const [r, g, b] = rgb.map((value) => {
    const c = value / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function ratio(a, b) {
  const [high, low] = [luminance(a), luminance(b)].sort((x, y) => y - x);
  return (high + 0.05) / (low + 0.05);
}

// The colour behind an element, shape (3,), and its opacity: that of its parent, kept in `known`,
// and its own layer.
function behind(element, known) {
  if (!element) return { rgb: [255, 255, 255], opacity: 1 };
  if (!known.has(element)) {
    const below = behind(element.parentElement, known);
    const style = getComputedStyle(element);
    const own = channels(style.backgroundColor);
    const rgb = own && own.alpha > 0 ? over(own.rgb, own.alpha, below.rgb) : below.rgb;
    known.set(element, { rgb, opacity: below.opacity * Number(style.opacity) });
  }
  return known.get(element);
}

// Texts with less contrast than WCAG 2 AA: 4.5, large ones 3.
function contrast() {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const wrong = new Map();
  const known = new Map();
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || element.closest("script, style, noscript")) continue;
    if (!element.checkVisibility({ visibilityProperty: true })) continue;
    const style = getComputedStyle(element);
    const svg = element instanceof SVGElement;
    const ink = channels(svg ? style.fill : style.color);
    if (!ink) continue;
    const { rgb, opacity } = behind(element, known);
    if (opacity === 0) continue;
    const seen = over(ink.rgb, ink.alpha * opacity * (svg ? Number(style.fillOpacity) : 1), rgb);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const found = ratio(seen, rgb);
    if (found < (large ? 3 : 4.5)) wrong.set(named(element), found.toFixed(2));
  }
  return [...wrong].map(([name, found]) => `${name}: contrast ${found}`);
}

// What can be operated and is in sight, marked with a number.
function operable() {
  const all = "a[href], button, select, input, textarea, summary, [tabindex], audio[controls]";
  const found = [...document.querySelectorAll(all)].filter((one) =>
    one.checkVisibility({ visibilityProperty: true }) && !one.disabled && one.tabIndex >= 0);
  const radios = (one) => one.type === "radio" && !one.checked;
  return found.filter((one) => !radios(one)).map((one, k) => {
    one.dataset.operable = k;
    return named(one);
  });
}

// The number of the element that has the focus, and whether that can be seen on it.
function focused() {
  const one = document.activeElement;
  if (!one || one === document.body) return null;
  const style = getComputedStyle(one);
  const outlined = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 1;
  const box = one.getBoundingClientRect();
  const inside = box.width > 0 && box.bottom > 0 && box.top < innerHeight;
  const on = inside && box.right > 0 && box.left < innerWidth;
  return { number: Number(one.dataset.operable ?? -1), name: named(one), visible: outlined && on };
}
