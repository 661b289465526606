(async () => {
  const look = JSON.parse(document.getElementById("look").textContent);
  const drawn = [];
  const tell = (name, value) => {
    for (const { view, names } of drawn) if (names.includes(name)) view.signal(name, value).runAsync();
  };
  const slider = document.getElementById("round");
  if (slider) {
    const rounds = JSON.parse(slider.dataset.rounds);
    const layers = [...document.querySelectorAll("[data-round]")];
    const show = () => {
      const round = rounds[slider.valueAsNumber];
      document.getElementById("round-label").textContent = `Round ${round}`;
      for (const layer of layers) layer.classList.toggle("on", layer.dataset.round === String(round));
      tell("shown", round);
    };
    const step = (by) => {
      slider.valueAsNumber = (slider.valueAsNumber + by + rounds.length) % rounds.length;
      show();
    };
    slider.addEventListener("input", show);
    document.getElementById("previous").addEventListener("click", () => step(-1));
    document.getElementById("next").addEventListener("click", () => step(1));
    const everything = document.getElementById("everything");
    everything.addEventListener("change", () => tell("everything", everything.checked));
  }
  // Rows alike; what is left alone takes a whole row. Before the charts, which ask for their width.
  const lay = () => {
    for (const [kind, least, gap] of [[".tiles", 140, 10], [".cards", 340, 12]])
      for (const grid of document.querySelectorAll(kind)) {
        const count = grid.childElementCount;
        const fit = Math.max(1, Math.floor((grid.clientWidth + gap) / (least + gap)));
        const columns = Math.ceil(count / Math.ceil(count / fit));
        grid.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
        grid.lastElementChild.style.gridColumn = count % columns === 1 ? "1 / -1" : "";
      }
  };
  lay();
  window.addEventListener("resize", lay);
  for (const place of document.querySelectorAll(".chart")) {
    const { spec, aspect } = JSON.parse(place.firstChild.textContent);
    const names = (spec.params ?? []).map((param) => param.name);
    for (const [name, columns] of Object.entries(spec.datasets)) {
      const keys = Object.keys(columns);
      // Without rows there are no columns.
      spec.datasets[name] = (columns[keys[0]] ?? []).map((_, row) =>
        Object.fromEntries(keys.map((key) => [key, columns[key][row]])));
    }
    // A map is as high as its width asks for.
    const shaped = (vega) => {
      if (!aspect) return vega;
      delete vega.height;
      vega.signals.push({ name: "height", update: `width * ${aspect}` });
      return vega;
    };
    // `ast`: expressions are interpreted, so that no script is made from text.
    const { view } = await vegaEmbed(place, spec, {
      actions: false, ast: true, config: look, defaultStyle: false, patch: shaped,
      renderer: "svg", tooltip: { disableDefaultStyle: true },
    });
    drawn.push({ view, names });
  }
  document.documentElement.dataset.drawn = drawn.length;
})();
