// The browser's side of softshadow.widget: it says what the pointer does, and shows what comes back.

function make(parent, tag, attributes = {}) {
  const element = Object.assign(document.createElement(tag), attributes);
  parent.append(element);
  return element;
}

function labelled(parent, text, tag, attributes) {
  return make(make(parent, "label", { textContent: `${text} ` }), tag, attributes);
}

function options(select, names) {
  for (const name of names) make(select, "option", { value: name, textContent: name });
}

// One request at a time: what happens until its answer comes becomes the next one.
function requests(model) {
  let next = null;
  let waiting = false;
  const send = () => {
    waiting = true;
    model.send(next);
    next = null;
  };
  return {
    ask(change) {
      next = { ...next, ...change };
      if (!waiting) send();
    },
    answered() {
      waiting = false;
      if (next) send();
    },
  };
}

function drags(canvas, model, ask) {
  let from = null;
  const scale = () => canvas.width / canvas.clientWidth;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    from = { start: model.get("center"), x: event.clientX, y: event.clientY, away: event.shiftKey };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    const pixels = [(event.clientX - from.x) * scale(), (event.clientY - from.y) * scale()];
    ask({ drag: { start: from.start, pixels, away: from.away } });
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, () => (from = null));
  }
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in arrows)) return;
    event.preventDefault();
    event.stopPropagation(); // the notebook would go to another cell
    const pixels = arrows[event.key].map((x) => x * canvas.height * 0.02);
    ask({ drag: { start: model.get("center"), pixels, away: event.shiftKey } });
  });
}

function render({ model, el }) {
  el.classList.add("softshadow-widget");
  const canvas = make(el, "canvas", {
    tabIndex: 0,
    title: "Drag to move the light; with Shift: away from you and back. Arrow keys do the same.",
  });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The scene; drag or use the arrow keys to move its light");
  const controls = make(el, "div", { className: "softshadow-controls" });
  const [least, most] = model.get("widths");
  const range = { type: "range", min: least, max: most, step: (most - least) / 500 };
  const width = labelled(controls, "light's width", "input", range);
  const method = labelled(controls, "method", "select");
  const what = labelled(controls, "show", "select");
  options(method, model.get("methods"));
  options(what, ["radiance", "visibility"]);
  const text = make(el, "div", { className: "softshadow-text" });
  const error = make(el, "div", { className: "softshadow-error" });
  error.setAttribute("role", "alert");

  const { ask, answered } = requests(model);
  drags(canvas, model, ask);
  width.addEventListener("input", () => ask({ width: Number(width.value) }));
  method.addEventListener("change", () => ask({ method: method.value }));
  what.addEventListener("change", () => ask({ what: what.value }));

  const picture = async () => {
    const bytes = model.get("picture");
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
    if (bytes !== model.get("picture")) return; // a newer one is on its way
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
  };
  const state = () => {
    if (document.activeElement !== width) width.value = model.get("width");
    method.value = model.get("method");
    what.value = model.get("what");
    text.textContent = model.get("text");
    error.textContent = model.get("error");
    el.classList.toggle("softshadow-stale", model.get("error") !== "");
  };
  const answer = () => {
    state();
    answered();
  };
  picture();
  state();
  model.on("change:picture", picture);
  model.on("change:answers", answer);
  return () => {
    model.off("change:picture", picture);
    model.off("change:answers", answer);
  };
}

export default { render };
