// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Makes elements of HTML and SVG.

const INK = "#222222", GREY = "#5f5f5f", WARN = "#d55e00", BLUE = "#0072b2", ABOVE = "#cc3311", WEAK = "#b0b0b0", GREEN = "#009e73";

/** An element of HTML; an attribute that is undefined or false is left out. */
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/** An element of SVG. */
function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}
