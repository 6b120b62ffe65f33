// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows the summary above the charts, and below them what made the log.

byId("subtitle").textContent = data.subtitle;
byId("answer").textContent = data.answer ?? "";
byId("answer").hidden = !data.answer;
byId("answer").classList.toggle("calm", Boolean(data.calm));
byId("inputs").append(...(data.inputs ?? []).map(sentence => element("li", {}, sentence)));
for (const { label, value, alert } of data.summary) {
  byId("summary").append(element("div", { class: alert ? "alert" : undefined }, element("dt", {}, label), element("dd", {}, value)));
}
const provenance = byId("provenance");
provenance.append(element("h2", {}, data.provenance.title), element("table", {}, element("tbody", {},
  ...data.provenance.rows.map(cells => element("tr", {}, ...cells.map(text => element("td", {}, text)))))));
for (const { name, text } of data.provenance.files) {
  provenance.append(element("details", {}, element("summary", {}, name), element("pre", { tabindex: 0 }, text)));
}
