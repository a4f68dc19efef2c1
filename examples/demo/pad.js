// A pad of two ratings: props.value is {x, y, ranges, names, words} as JSON; dragging sets x and y.
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
  const share = (axis) => (state[axis] - state.ranges[axis][0]) / (state.ranges[axis][1] - state.ranges[axis][0]);
  dot.style.left = `${100 * share("x")}%`;
  dot.style.bottom = `${100 * share("y")}%`;
  pad.setAttribute("aria-valuetext", `${state.names.x} ${state.x}, ${state.names.y} ${state.y}`);
}
function set(axis, share) {
  const [low, high] = state.ranges[axis], value = low + Math.min(Math.max(share, 0), 1) * (high - low);
  state[axis] = Number(value.toFixed(high - low > 20 ? 0 : 2));
}
function send() {
  place();
  props.value = JSON.stringify({ ...state });
  trigger("input");
}
function follow(event) {
  const { left, bottom, width, height } = pad.getBoundingClientRect();
  set("x", (event.clientX - left) / width);
  set("y", (bottom - event.clientY) / height);
  send();
}
pad.addEventListener("pointerdown", (event) => { held = true; pad.setPointerCapture(event.pointerId); follow(event); });
pad.addEventListener("pointermove", (event) => { if (held) follow(event); });
for (const name of ["pointerup", "pointercancel"]) pad.addEventListener(name, () => { held = false; });
pad.addEventListener("keydown", (event) => {
  const [axis, sign] = { ArrowLeft: ["x", -1], ArrowRight: ["x", 1], ArrowDown: ["y", -1], ArrowUp: ["y", 1] }[event.key] || [];
  if (!axis) return;
  const [low, high] = state.ranges[axis];
  set(axis, (state[axis] - low) / (high - low) + sign * (event.shiftKey ? 0.1 : 0.02));
  send();
  event.preventDefault();
});
watch("value", show);
show();
