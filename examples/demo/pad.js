// A pad of two ratings, 0 to 100: props.value is {x, y, names, words} as JSON; dragging sets x and y.
"use strict";
const pad = element.querySelector(".pad"), dot = element.querySelector(".dot");
let held = false, state = null;
function place() {
  dot.style.left = `${state.x}%`;
  dot.style.bottom = `${state.y}%`;
  pad.setAttribute("aria-valuetext", `${state.names.x} ${state.x}, ${state.names.y} ${state.y}`);
}
function show() {
  if (!props.value || held) return;
  state = JSON.parse(props.value);
  place();
  for (const side in state.words) element.querySelector("." + side).textContent = state.words[side];
}
function send(values) {
  for (const axis in values) state[axis] = Math.min(Math.max(Math.round(values[axis]), 0), 100);
  place();
  props.value = JSON.stringify(state);
  trigger("input");
}
function follow({ clientX, clientY }) {
  const { left, bottom, width, height } = pad.getBoundingClientRect();
  send({ x: (100 * (clientX - left)) / width, y: (100 * (bottom - clientY)) / height });
}
pad.onpointerdown = (event) => { held = true; pad.setPointerCapture(event.pointerId); follow(event); };
pad.onpointermove = (event) => { if (held) follow(event); };
pad.onpointerup = pad.onpointercancel = () => { held = false; };
pad.onkeydown = (event) => {
  const [axis, sign] = { ArrowLeft: ["x", -1], ArrowRight: ["x", 1], ArrowDown: ["y", -1], ArrowUp: ["y", 1] }[event.key] || [];
  if (!axis) return;
  send({ [axis]: state[axis] + sign * (event.shiftKey ? 10 : 2) });
  event.preventDefault();
};
watch("value", show);
show();
