// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows the verdict above the charts, and below them what made the log.

byId("subtitle").textContent = data.subtitle;
byId("answer").textContent = data.answer ?? "";
byId("answer").hidden = !data.answer;
byId("answer").classList.toggle("calm", Boolean(data.calm));
byId("inputs").append(...data.inputs.map(sentence => element("li", {}, sentence)));
byId("rest").hidden = !data.rest;
byId("rest").append(element("p", {}, data.rest));
const provenance = byId("provenance");
provenance.append(element("table", {}, element("tbody", {},
  ...data.provenance.rows.map(cells => element("tr", {}, ...cells.map(text => element("td", {}, text)))))));
for (const { name, text } of data.provenance.files) {
  provenance.append(element("details", {}, element("summary", {}, name), element("pre", { tabindex: 0 }, text)));
}
