"use strict";
(() => {
  const sections = new Map();
  for (const box of document.querySelectorAll(".pictures")) {
    const id = box.id.replace(/-pictures$/, "");
    sections.set(id, new DriveSection(box, JSON.parse(document.getElementById(`${id}-data`).textContent)));
  }
  for (const button of document.querySelectorAll(".events button")) {
    button.addEventListener("click", () => {
      const section = sections.get(button.dataset.section), at = Number(button.dataset.at);
      section.zoom([at - 15, at + 45]);
      section.showWaveforms(at);
      section.box.scrollIntoView({ block: "start" });
    });
  }
  addEventListener("resize", () => { for (const section of sections.values()) section.resize(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const section of sections.values()) section.draw(); });
})();
