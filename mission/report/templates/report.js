(async () => {
  const look = JSON.parse(document.getElementById("look").textContent);
  const drawn = [];
  const tell = (name, value) => {
    for (const { view, names } of drawn) if (names.includes(name)) view.signal(name, value).runAsync();
  };
  // The map at an instant: who is where, and what was heard, lost and said in the seconds before.
  let played = () => {};
  const clock = document.getElementById("clock");
  if (clock) {
    const film = JSON.parse(document.getElementById("film").textContent);
    const button = document.getElementById("play"), told = document.getElementById("now");
    const AGO = 4, WHOLE = 30; // seconds: how long news are told, what playing takes
    let t = film.from, running = false;
    const show = () => {
      const at = (t - film.from) / film.step, i = Math.floor(at), share = at - i;
      const rows = [], words = [`${t.toFixed(1)} s`];
      for (const { name, colour, places } of film.seen) {
        const [here, next] = [places[i], places[i + 1] ?? places[i]];
        if (!here || !next) continue;
        const [x, y, z] = here.map((value, axis) => value + share * (next[axis] - value));
        rows.push({ x, y, colour, shape: "circle" });
        words.push(`${name} ${z.toFixed(0)} m high`.trim());
      }
      for (const [when, text, x, y, colour] of film.news) {
        if (when > t || when < t - AGO) continue;
        words.push(text);
        if (colour) rows.push({ x, y, colour, shape: "triangle-down" });
      }
      told.textContent = words.join(" · ");
      clock.value = t;
      for (const { view, names } of drawn) if (names.includes("now")) view.data("now", rows).runAsync();
    };
    const toggle = (on) => {
      running = on;
      button.textContent = on ? "❚❚" : "▶";
      button.ariaLabel = on ? "pause" : "play";
    };
    const play = (before) => requestAnimationFrame((now) => {
      const rate = Math.max(1, (clock.max - clock.min) / WHOLE);
      t = Math.min(t + rate * (now - before) / 1000, Number(clock.max));
      if (running) show();
      if (running && t < clock.max) play(now); else toggle(false);
    });
    button.addEventListener("click", () => {
      toggle(!running);
      if (running && t >= clock.max) t = Number(clock.min);
      if (running) play(performance.now());
    });
    clock.addEventListener("input", () => { toggle(false); t = clock.valueAsNumber; show(); });
    played = (round) => {
      [clock.min, clock.max] = film.spans[round] ?? film.spans[0] ?? [film.from, film.from];
      t = Number(clock.min);
      show();
    };
  }
  const slider = document.getElementById("round");
  if (slider) {
    const rounds = JSON.parse(slider.dataset.rounds);
    const layers = [...document.querySelectorAll("[data-round]")];
    const show = () => {
      const round = rounds[slider.valueAsNumber];
      document.getElementById("round-label").textContent = `Round ${round}`;
      for (const layer of layers) layer.classList.toggle("on", layer.dataset.round === String(round));
      tell("shown", round);
      played(round);
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
    drawn.push({ view, names: [...names, ...Object.keys(spec.datasets)] });
  }
  played(slider ? JSON.parse(slider.dataset.rounds)[0] : 0);
  document.documentElement.dataset.drawn = drawn.length;
})();
