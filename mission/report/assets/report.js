"use strict";
(() => {
  const slider = document.getElementById("round");
  if (!slider) return;
  const rounds = JSON.parse(slider.dataset.rounds);
  const label = document.getElementById("round-label");
  const layers = [...document.querySelectorAll("[data-round]")];
  const show = () => {
    const round = String(rounds[slider.valueAsNumber]);
    label.textContent = `Round ${round}`;
    for (const layer of layers) layer.classList.toggle("on", layer.dataset.round === round);
  };
  const step = (by) => {
    slider.valueAsNumber = (slider.valueAsNumber + by + rounds.length) % rounds.length;
    show();
  };
  slider.addEventListener("input", show);
  document.getElementById("previous").addEventListener("click", () => step(-1));
  document.getElementById("next").addEventListener("click", () => step(1));
  document.getElementById("all").addEventListener("change", (event) => {
    document.body.classList.toggle("all", event.target.checked);
  });
  show();
})();
