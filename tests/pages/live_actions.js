// Does a number of random actions on the live page, from a seed; an action is what a mouse, a finger or a key would do.
async ([seed, count]) => {
  let state = seed;
  const random = () => (state = (state * 48271) % 2147483647) / 2147483647;
  const pick = (list) => list[Math.floor(random() * list.length)];
  const all = (selector) => [...document.querySelectorAll(selector)];
  const send = (target, kind) => target.dispatchEvent(new Event(kind));
  all("details").forEach((d) => { d.open = true; });

  function slider() {
    const { name, min, max } = pick(liveControls), range = document.getElementById(`range-${name}`);
    range.value = min + random() * (max - min);
    send(range, "input");
    if (random() < 0.5) send(range, "change");
  }

  function typed() {
    const field = document.getElementById(`field-${pick(liveControls).name}`);
    field.value = pick(["1", "0,5", "x", "", "1e9", "-3"]);
    send(field, "input");
    send(field, "change");
  }

  function chosen() {
    const select = pick(all("#preset, #release, #language"));
    select.value = pick([...select.options]).value;
    send(select, "change");
  }

  function dragged() {
    const canvas = pick(all("#stage, #map, .plot canvas + canvas")), box = canvas.getBoundingClientRect();
    const place = () => ({ clientX: box.left + random() * box.width, clientY: box.top + random() * box.height, buttons: 1, bubbles: true });
    canvas.setPointerCapture = () => {};  // no pointer of this kind is there to be captured
    for (const kind of ["pointerdown", "pointermove", "pointerup"]) canvas.dispatchEvent(new PointerEvent(kind, place()));
    canvas.dispatchEvent(new MouseEvent("click", place()));
  }

  function key() {
    const name = pick(["ArrowLeft", "ArrowRight", "ArrowUp", "PageDown", "Home", "End", "Enter", "Escape", " ", "z"]);
    const options = { key: name, ctrlKey: random() < 0.2, shiftKey: random() < 0.3, bubbles: true };
    pick(all("body, button, #time, #map, .table, [id^=range]")).dispatchEvent(new KeyboardEvent("keydown", options));
  }

  function trial() {
    const field = pick(all("#trial-options select, #trial-options input[type=text]").filter(({ options }) => !options || options.length));
    field.value = field.options ? pick([...field.options]).value : pick(["0,1", "x", "", "30", "-2"]);
    send(field, "change");
  }

  function dropped() {
    const rows = Array.from({ length: 30 }, (_, i) => `${i / 50},${-0.5 + i / 100},${-0.1 * random()}`);
    const data = new DataTransfer();
    data.items.add(new File([pick(["", "t,light_x\n1,x\n", ["t,light_x,light_y", ...rows].join("\n")])], "some.csv"));
    document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
  }

  function predicted() {
    const input = pick(all("#lesson-options input"));
    if (input.type === "radio") input.click();
    else { input.value = pick(["3", "4,9", "x"]); send(input, "input"); }
  }

  const links = ["", "mass_ratio=3", "release=held&release_angle_deg=30", "nonsense", "rod_radius_mm=1e5", "%E0%A4"];
  const actions = [
    slider, typed, chosen, dragged, key, predicted, trial, dropped,
    // Browsers let nobody but a person print or fill the screen
    () => pick(all("button:not([id^=save], #full, #worksheet, #teacher-sheets)").filter((b) => !b.disabled && b.checkVisibility())).click(),
    () => pick(all("input[type=checkbox]")).click(),
    () => { location.hash = pick(links); },
  ];
  for (let i = 0; i < count; i++) {
    pick(actions)();
    if (random() < 0.3) await new Promise((done) => requestAnimationFrame(done));
  }
  return live.frames;
}
