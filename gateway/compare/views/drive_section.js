"use strict";
// Pictures over one axis of time that zoom together: those of a drive's page and of the viewer.
const DriveSection = (() => {
  const HEIGHT = 210;
  const element = (tag, className, text) => {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  };
  // With as many decimals as a step between two times needs.
  const clock = (seconds, step = 1) => {
    const decimals = Math.max(0, Math.min(6, Math.ceil(-Math.log10(step) - 1e-9)));
    const whole = Math.max(0, Number(seconds.toFixed(decimals)));
    const part = (value) => String(value).padStart(2, "0");
    const fraction = decimals ? (whole % 1).toFixed(decimals).slice(1) : "";
    return `${Math.floor(whole / 3600)}:${part(Math.floor(whole / 60) % 60)}:${part(Math.floor(whole % 60))}${fraction}`;
  };

  const titleOf = ({ label, unit }) => (unit ? `${label}, ${unit}` : label);

  class Section {
    // `whole`: the axis of time, else that of the data. `shortest`: what is zoomed to. `onZoom`, `onMoment`: what else
    // a zoom and a click do; a click shows the waveforms of the data where nothing else is said.
    constructor(box, data, { whole = null, shortest = 0.5, onZoom = null, onMoment = null } = {}) {
      Object.assign(this, { box, data, shortest, onZoom, onMoment });
      this.sync = `drive-${box.id}`;
      this.plots = new Map();
      this.added = [];
      this.take(data);
      this.whole = whole || [this.times[0], this.times[this.times.length - 1]];
      this.range = [...this.whole];
      this.tools();
      this.grid = element("div", "grid");
      this.box.append(this.grid);
      if (!onMoment) this.showWaveforms(this.whole[0]);
      this.draw();
    }

    take(data) {
      this.data = data;
      this.open = [...data.first];
      // What is drawn with a quantity, on an axis of its own.
      this.second = new Map(Object.entries(data.pairs || {}));
      // Wheels are drawn all, or by choice.
      this.choice = data.choices ? data.choices[data.chosen] : null;
      // One axis of time for all wheels: undefined is drawn through.
      this.times = [...new Set(data.wheels.flatMap((wheel) => wheel.t))].sort((a, b) => a - b);
      const index = new Map(this.times.map((time, i) => [time, i]));
      this.rows = data.wheels.map((wheel) => wheel.t.map((time) => index.get(time)));
    }

    isChosen(i) { return !this.choice || this.choice.wheels.includes(i); }

    styleOf(i) { return this.data.wheels[i].style ?? i; }

    quantity(name) { return this.data.quantities.find((one) => one.name === name); }

    // A list of choices; `act` takes the value of the chosen one.
    chooser(label, choices, act) {
      const select = element("select");
      select.setAttribute("aria-label", label);
      this.offer(select, choices);
      select.addEventListener("change", () => act(select.value));
      return select;
    }

    offer(select, choices) {
      select.replaceChildren(...choices.map(([value, text]) => {
        const option = element("option", "", text);
        option.value = value;
        return option;
      }));
    }

    tools() {
      const bar = element("div", "tools");
      const button = (text, label, act) => {
        const made = element("button", "", text);
        made.type = "button";
        made.setAttribute("aria-label", label);
        made.addEventListener("click", act);
        bar.append(made);
      };
      button("Whole", "show all of it", () => this.zoom(this.whole));
      button("+", "zoom in", () => this.scale(0.5, 0));
      button("−", "zoom out", () => this.scale(2, 0));
      button("←", "earlier", () => this.scale(1, -0.5));
      button("→", "later", () => this.scale(1, 0.5));
      this.select = this.chooser("add a picture", [], (name) => {
        this.open.push(name);
        this.draw();
      });
      bar.append(this.select);
      const { choices, chosen } = this.data;
      if (choices && choices.length > 1) {
        const wheel = this.chooser("wheel", choices.map(({ name }, at) => [at, `wheel ${name}`]), (at) => {
          this.choice = choices[at];
          this.draw();
          this.showWaveforms(this.shown ? this.shown.time : this.whole[0]);
        });
        wheel.value = chosen;
        bar.prepend(wheel);
      }
      this.waveform = element("div", "waveform");
      this.box.append(bar);
    }

    scale(factor, shift) {
      const [begin, end] = this.range, middle = (begin + end) / 2 + shift * (end - begin), half = (factor * (end - begin)) / 2;
      this.zoom([middle - half, middle + half]);
    }

    zoom([begin, end]) {
      const length = Math.min(Math.max(end - begin, this.shortest), this.whole[1] - this.whole[0]);
      const first = Math.min(Math.max(begin, this.whole[0]), this.whole[1] - length);
      this.range = [first, first + length];
      for (const plot of [...this.plots.values(), ...this.added]) plot.setScale("x", { min: this.range[0], max: this.range[1] });
      if (this.onZoom) this.onZoom();
    }

    columns(quantity, wheels) {
      const data = [this.times];
      for (const i of wheels) {
        const { v, e, provisional } = quantity.wheels[i], isProvisional = new Set(provisional);
        const columns = [0, 1, 2, 3].map(() => new Array(this.times.length).fill(undefined));
        let previous = null;
        v.forEach((value, at) => {
          const row = this.rows[i][at];
          pictures.cellsOf(value, e ? e[at] : null, isProvisional.has(at)).forEach((cell, part) => {
            columns[part][row] = cell;
            // The times of other wheels within a gap are part of it.
            if (previous !== null && (cell === null || columns[part][previous] === null)) columns[part].fill(null, previous + 1, row);
          });
          previous = row;
        });
        data.push(...columns);
      }
      return data;
    }

    draw() {
      for (const plot of this.plots.values()) plot.destroy();
      this.plots.clear();
      this.grid.replaceChildren(...this.open.map((name) => this.picture(name)));
      if (this.waveform.childElementCount) this.grid.append(...this.waveform.children);
      const drawn = [...this.open, ...this.open.map((name) => this.second.get(name))];
      const closed = this.data.quantities.filter((quantity) => !drawn.includes(quantity.name));
      this.offer(this.select, [["", "Add a picture …"], ...closed.map((quantity) => [quantity.name, titleOf(quantity)])]);
      this.resize();
    }

    picture(name) {
      const quantity = this.quantity(name), second = this.quantity(this.second.get(name));
      const figure = element("figure"), title = element("div", "picture-title");
      title.append(element("span", "", titleOf(quantity)));
      const others = this.data.quantities.filter((one) => one !== quantity).map((one) => [one.name, `thin: ${titleOf(one)}`]);
      const beside = this.chooser(`draw with ${quantity.label}`, [["", "and …"], ...others], (chosen) => {
        if (chosen) this.second.set(name, chosen);
        else this.second.delete(name);
        this.draw();
      });
      beside.value = second ? second.name : "";
      beside.classList.toggle("empty", !second);
      const close = element("button", "", "×");
      close.type = "button";
      close.setAttribute("aria-label", `close the picture of ${quantity.label}`);
      close.addEventListener("click", () => { this.open = this.open.filter((one) => one !== name); this.draw(); });
      title.append(beside, close);
      const box = element("div"), legend = element("ul", "legend");
      const wheelsOf = (one) => this.data.wheels.map((_, i) => i).filter((i) => this.isChosen(i) && one.wheels[i]);
      const wheels = wheelsOf(quantity), also = second ? wheelsOf(second) : [];
      const names = second ? `${quantity.label} and ${second.label}` : quantity.label;
      box.setAttribute("role", "img");
      box.setAttribute("aria-label", `${names} over time of ${wheels.map((i) => this.data.wheels[i].name).join(", ")}`);
      figure.append(title, box, legend);
      const read = (u) => this.read(u, quantity, second, wheels, legend);
      const plot = this.overTime(box, [...this.columns(quantity, wheels), ...(second ? this.lines(second, also) : [])], {
        series: [
          ...wheels.flatMap((i) => pictures.seriesOf(this.styleOf(i), { isPrinted: true })),
          ...also.map((i) => ({ scale: "second", stroke: pictures.colourOf(this.styleOf(i)), width: 1, points: { show: false } })),
        ],
        bands: pictures.bandsOf(wheels.map((i) => this.styleOf(i))),
        second: second ? titleOf(second) : "",
      }, read);
      this.plots.set(name, plot);
      read(plot);
      return figure;
    }

    // One line a wheel: valid and provisional alike.
    lines(quantity, wheels) {
      const data = this.columns(quantity, wheels);
      return wheels.map((_, at) => data[4 * at + 1].map((value, row) => (value === null ? data[4 * at + 2][row] : value)));
    }

    // A picture over the common time, with its cursor, zoom and events.
    overTime(box, data, { series, bands, second = "", height = HEIGHT, draw = [], y = {}, yAxis = {} }, read = () => {}) {
      const axis = pictures.axis();
      return new uPlot({
        width: 420, height, legend: { show: false },
        cursor: { sync: { key: this.sync, scales: ["x", null] }, drag: { x: true, y: false } },
        scales: { x: { time: false, min: this.range[0], max: this.range[1] }, y },
        axes: [{ ...axis, space: 80, values: (_, ticks, __, ___, step) => ticks.map((tick) => clock(tick, step)) }, { ...axis, size: pictures.widthFrom(58), ...yAxis }, ...(second ? [{ ...axis, scale: "second", side: 1, size: pictures.widthFrom(48), grid: { show: false } }] : [])],
        series: [{}, ...series],
        bands,
        hooks: {
          draw: [...draw, (u) => this.drawEvents(u)],
          setCursor: [read],
          setSelect: [(u) => {
            if (u.select.width > 3) this.zoom([u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")]);
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
          ready: [(u) => {
            u.over.addEventListener("click", () => {
              if (u.cursor.left >= 0) (this.onMoment || ((time) => this.showWaveforms(time, true)))(u.posToVal(u.cursor.left, "x"));
            });
            u.over.addEventListener("dblclick", () => this.zoom(this.whole));
          }],
        },
      }, data, box);
    }

    // The values at the cursor, else the last ones.
    read(u, quantity, second, wheels, legend) {
      const time = u.cursor.idx == null ? Infinity : this.times[u.cursor.idx];
      const textOf = (one, i) => {
        const { v, e, provisional } = one.wheels[i], times = this.data.wheels[i].t;
        let last = times.length - 1;
        while (last > 0 && times[last] > time) last -= 1;
        if (time === Infinity) while (last > 0 && v[last] === null) last -= 1;
        return v[last] == null ? "—" : pictures.written(v[last], e ? e[last] : null, one.unit, provisional.includes(last), one.name);
      };
      legend.replaceChildren(...wheels.map((i) => {
        const texts = [quantity, second].filter((one) => one && one.wheels[i]).map((one) => textOf(one, i));
        const item = element("li"), style = this.styleOf(i);
        item.append(pictures.key(style, pictures.dashOf(style)), `${this.data.wheels[i].name}: ${texts.join(", ")}`);
        return item;
      }));
    }

    drawEvents(u) {
      const { left, top, width, height } = u.bbox, right = left + width;
      u.ctx.save();
      for (const event of this.data.events) {
        const from = u.valToPos(event.begin, "x", true);
        const to = event.end === null ? right : u.valToPos(event.end, "x", true);
        if (to < left || from > right) continue;
        if (event.kind === "alarm" || event.kind === "silence") {
          u.ctx.fillStyle = pictures.css("--alarm");
          u.ctx.fillRect(Math.max(from, left), top, Math.max(Math.min(to, right) - Math.max(from, left), 3), 4 * devicePixelRatio);
        } else if (event.kind === "mark") {
          u.ctx.strokeStyle = pictures.css("--ink");
          u.ctx.setLineDash([4, 4]);
          u.ctx.beginPath();
          u.ctx.moveTo(from, top);
          u.ctx.lineTo(from, top + height);
          u.ctx.stroke();
        }
      }
      u.ctx.restore();
    }

    // Of each wheel the waveform next to a time.
    showWaveforms(time, isAsked = false) {
      const nearest = this.data.wheels.map((_, i) => this.data.waveforms.filter((one) => one.wheel === i && this.isChosen(i))
        .reduce((best, one) => (best && Math.abs(best.t - time) <= Math.abs(one.t - time) ? best : one), null)).filter(Boolean);
      if (!nearest.length) return;
      const figure = element("figure"), title = element("div", "picture-title"), box = element("div"), legend = element("ul", "legend");
      title.append(element("span", "", "waveform of one revolution: radial axis, m/s²"));
      const angles = [...new Set(nearest.flatMap((one) => one.angle))].sort((a, b) => a - b);
      const index = new Map(angles.map((angle, i) => [angle, i]));
      const data = [angles, ...nearest.map((one) => {
        const column = new Array(angles.length).fill(undefined);
        one.angle.forEach((angle, i) => { column[index.get(angle)] = one.radial[i]; });
        return column;
      })];
      const label = nearest.map((one) => `${this.data.wheels[one.wheel].name} at ${clock(one.t)}`).join(", ");
      box.setAttribute("role", "img");
      box.setAttribute("aria-label", `waveform of the radial axis over the angle: ${label}`);
      figure.append(title, box, legend);
      const axis = pictures.axis();
      const plot = new uPlot({
        width: 420, height: HEIGHT, legend: { show: false },
        scales: { x: { time: false } },
        axes: [{ ...axis, values: (_, ticks) => ticks.map((tick) => `${tick}°`) }, { ...axis, size: pictures.widthFrom(58) }],
        series: [{}, ...nearest.map((one) => pictures.seriesOf(this.styleOf(one.wheel), { isPrinted: true })[0])],
      }, data, box);
      legend.replaceChildren(...nearest.map((one) => {
        const item = element("li");
        const style = this.styleOf(one.wheel);
        item.append(pictures.key(style, pictures.dashOf(style)), `${this.data.wheels[one.wheel].name} at ${clock(one.t)}${one.cause ? `, ${one.cause}` : ""}`);
        return item;
      }));
      if (this.shown) { this.shown.plot.destroy(); this.shown.figure.remove(); }
      this.shown = { plot, figure, time };
      this.grid.append(figure);
      this.resize();
      if (isAsked) figure.scrollIntoView({ block: "nearest" });
    }

    resize() {
      const all = [...this.plots.values(), ...this.added, ...(this.shown ? [this.shown.plot] : [])];
      if (this.shown && this.shown.figure.parentNode !== this.grid) this.grid.append(this.shown.figure);
      for (const plot of all) plot.setSize({ width: Math.max(plot.root.parentNode.clientWidth, 200), height: plot.height });
    }
  }

  return Object.assign(Section, { element, clock });
})();
