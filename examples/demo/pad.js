// A pad of two ratings, 0 to 100: props.value is {x, y, names, words} as JSON; dragging sets x and y.
"use strict";
const pad = element.querySelector(".pad"), dot = element.querySelector(".dot");
let held = false, state = null;
function show() {
  if (!props.value || held) return;
  state = JSON.parse(props.value);
  place();
  for (const side of ["left", "right", "bottom", "top"]) element.querySelector("." + side).textContent = state.words[side];
}
function place() {
  dot.style.left = `${state.x}%`;
  dot.style.bottom = `${state.y}%`;
  pad.setAttribute("aria-valuetext", `${state.names.x} ${state.x}, ${state.names.y} ${state.y}`);
}
function send(values) {
  for (const axis of ["x", "y"]) state[axis] = Math.min(Math.max(Math.round(values[axis] ?? state[axis]), 0), 100);
  place();
  props.value = JSON.stringify({ ...state });
  trigger("input");
}
function follow(event) {
  const { left, bottom, width, height } = pad.getBoundingClientRect();
  send({ x: (100 * (event.clientX - left)) / width, y: (100 * (bottom - event.clientY)) / height });
}
pad.addEventListener("pointerdown", (event) => { held = true; pad.setPointerCapture(event.pointerId); follow(event); });
pad.addEventListener("pointermove", (event) => { if (held) follow(event); });
for (const name of ["pointerup", "pointercancel"]) pad.addEventListener(name, () => { held = false; });
pad.addEventListener("keydown", (event) => {
  const [axis, sign] = { ArrowLeft: ["x", -1], ArrowRight: ["x", 1], ArrowDown: ["y", -1], ArrowUp: ["y", 1] }[event.key] || [];
  if (!axis) return;
  send({ [axis]: state[axis] + sign * (event.shiftKey ? 10 : 2) });
  event.preventDefault();
});
watch("value", show);
show();
