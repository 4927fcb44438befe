"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const STALE_MS = 3000, FIRST_RETRY_MS = 500, LAST_RETRY_MS = 5000, GAP_S = 3, SPAN_S = 600;
  let socket = null, retryMs = FIRST_RETRY_MS, heardMs = 0, state = null;
  let wheel = "", quantity = "speed_mps", quantities = [], points = new Map(), waveform = null;
  const plots = {};

  // Elements: text is only ever set as text.

  const element = (tag, className, text) => {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const setText = (target, text) => { if (target.textContent !== text) target.textContent = text; };
  const setRuns = (target, runs) => {
    const key = JSON.stringify(runs);
    if (target.dataset.key === key) return;
    target.dataset.key = key;
    target.replaceChildren(...runs.map(([text, role]) => element("span", role === "alarm" ? "role-alarm" : role, text)));
  };
  const setRows = (target, rows) => {
    while (target.children.length > rows.length) target.lastChild.remove();
    rows.forEach((row, i) => {
      if (!target.children[i]) target.append(element("li"));
      setRuns(target.children[i], typeof row === "string" ? [[row, ""]] : row);
    });
  };
  const { css, faint } = pictures;

  // The connection: it is made again whenever it is lost.

  const ask = (wish) => {
    const isOpen = socket && socket.readyState === WebSocket.OPEN;
    if (isOpen) socket.send(JSON.stringify(wish));
    return isOpen;
  };
  // What the user wants is not lost without a word.
  const want = (wish) => {
    const isSent = ask(wish);
    if (!isSent) setText(byId("said"), state && state.ended ? "not done: the session has ended" : "not done: no connection to treadlink");
    return isSent;
  };
  const askForTrend = () => { points = new Map(); ask({ trend: quantity }); };
  const connect = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/${location.search}`);
    socket.onopen = () => { retryMs = FIRST_RETRY_MS; ask({ wheel }); askForTrend(); };
    socket.onmessage = (event) => { heardMs = performance.now(); take(JSON.parse(event.data)); };
    socket.onclose = () => {
      setTimeout(connect, retryMs);
      retryMs = Math.min(2 * retryMs, LAST_RETRY_MS);
    };
  };
  const take = (message) => {
    if (message.type === "state") { state = message; showState(state); if (!state.ended) showHistory(state.alarms, state.alarms_since); }
    if (message.type === "waveform" && message.wheel === wheel) { waveform = message; showWaveform(); }
    if (message.type === "quantities") showQuantities(message.quantities);
    if (message.type === "trend" && message.name === quantity) mergeTrend(message);
    if (message.type === "said") {
      setText(byId("said"), message.text);
      if (message.text.startsWith("mark set")) remember(message.text, "");
    }
  };
  // Old numbers must not look alive: without news the wheels have an age instead.
  const watch = () => {
    const ageMs = performance.now() - heardMs;
    const isOld = !heardMs || ageMs > STALE_MS;
    const link = byId("link");
    const age = heardMs ? `no connection for ${Math.round(ageMs / 1000)} s` : "connecting";
    setText(link, state && state.ended ? "session ended" : isOld ? age : "connected");
    link.className = `pill ${isOld || (state && state.ended) ? "bad" : "good"}`;
    if (isOld && state && !state.ended) {
      const silent = { speed: ["—", "", state.drive.speed.unit, "", ""], edges: [], surroundings: [], car: [], numbers: [], counters: [], note: null };
      const wheels = state.wheels.map((one) => ({ ...one, ...silent, state: age, kind: "silent" }));
      const oldOf = (value) => (value && value.source !== "stated" && value.source !== "old" ? { ...value, source: "old", note: `${Math.round(ageMs / 1000)} s old` } : value);
      const unheard = state.drive.wheels.map((one) => ({ ...one, kind: "act", state: age, values: Object.fromEntries(Object.entries(one.values).map(([name, value]) => [name, oldOf(value)])) }));
      const drive = { kind: "act", step: "", line: `This page hears nothing from treadlink: ${age}.`, speed: { ...state.drive.speed, text: "—" }, alarms: [], wheels: unheard };
      showState({ ...state, drive, wheels, alarms: [], links: [[[age, "warning"]]], rolling: "" });
      waveform = null;
      showWaveform();
    }
  };

  // What was marked and what alarmed, since the page was opened.

  const HISTORY = 200, history = [], standing = new Map();
  const remember = (text, role, since = state ? state.elapsed : "") => {
    history.unshift([[since, "label"], [text, role]]);
    history.length = Math.min(history.length, HISTORY);
    setText(byId("history-note"), "since this page was opened, the last first");
    setRows(byId("history"), history);
    return history[0];
  };
  const showHistory = (alarms, since) => {
    // The value behind the colon changes while the alarm stands: its line is that of its begin, with the value of now.
    const present = new Map(alarms.map((text, index) => [text.split(":")[0], [`ALARM ${text}`, since[index]]]));
    for (const key of standing.keys()) if (!present.has(key)) { remember(`over: ${key}`, ""); standing.delete(key); }
    for (const [key, [text, begin]] of present) {
      if (standing.has(key)) standing.get(key)[1][0] = text;
      else standing.set(key, remember(text, "warning", begin));
    }
    if (present.size) setRows(byId("history"), history);
  };

  // The state

  const showState = (shown) => {
    setText(byId("elapsed"), `${shown.ended ? "ran" : "running"} ${shown.elapsed}`);
    setText(byId("rolling"), shown.rolling);
    const isRecording = shown.recording !== "" && !shown.ended;
    setText(byId("recording"), isRecording ? `REC ${shown.recording} ${shown.recorded}` : "not recording");
    byId("recording").className = `pill ${isRecording ? "good" : shown.may_record ? "warn" : ""}`;
    const record = byId("record");
    record.hidden = !shown.may_record;
    record.dataset.on = String(isRecording);
    setText(record, isRecording ? "Stop recording" : "Record");
    // The first one is the verdict.
    const isSaid = (text) => shown.drive.kind === "act" && shown.drive.line.startsWith(text);
    setRows(byId("alarms"), shown.alarms.filter((text) => !isSaid(text)).map((text) => `ALARM ${text}`));
    byId("acknowledge").hidden = !shown.to_acknowledge;
    if (!shown.wheels.some((one) => one.key === wheel) && shown.wheels.length) choose(shown.wheels[0].key);
    showUnits(shown.units, shown.unit_names);
    showDrive(shown.drive);
    showWheels(shown.wheels);
    setRows(byId("links"), [...shown.links, ...shown.outputs]);
    setRows(byId("notices"), [...shown.notices].reverse());
  };

  // The face for whoever drives: rounded to what an eye takes in, never finer than the error.

  const stored = (name, fallback) => { try { return localStorage.getItem(name) || fallback; } catch { return fallback; } };
  const store = (name, value) => { try { localStorage.setItem(name, value); } catch { /* private windows forget */ } };
  let face = stored("face", "engineer");
  const LABELS = { pressure_pa: "pressure", temperature_degc: "temperature", wear_mm: "wear", load_n: "load" };
  const tileOf = (one) => {
    const tile = element("div", `tile ${one.kind}`), top = element("div", "top"), list = element("dl");
    top.append(element("span", "", one.position), element("span", "is", one.state));
    for (const [name, label] of Object.entries(LABELS)) {
      const value = one.values[name], box = element("div");
      const number = element("dd", value ? value.source : "unknown");
      if (value) {
        number.append(value.text, element("small", "", ` ${value.unit}`));
      } else number.append("—");
      const note = value ? value.note : "unknown";
      box.append(element("dt", "", note ? `${label}, ${note}` : label), number);
      list.append(box);
    }
    tile.append(top, list);
    if (one.place) { tile.style.gridRow = one.place[0] + 1; tile.style.gridColumn = one.place[1] ? 3 : 1; }
    return tile;
  };
  const showDrive = (drive) => {
    const line = byId("drive-line"), car = byId("car"), key = JSON.stringify(drive);
    if (car.dataset.key === key) return;
    car.dataset.key = key;
    line.replaceChildren(...(drive.step ? [element("b", "", drive.step), element("small", "", drive.line)] : [drive.line]));
    byId("drive-speed").replaceChildren(drive.speed.text, element("small", "", ` ${drive.speed.unit}`));
    line.className = drive.kind;
    line.setAttribute("role", drive.kind === "act" ? "alert" : "status");
    setRows(byId("more-alarms"), drive.alarms);
    const places = drive.wheels.map((one) => one.place && one.place.join());
    const isCar = drive.wheels.length > 1 && places.every(Boolean) && new Set(places).size === places.length;
    car.className = isCar ? "car" : "";
    car.replaceChildren(...(isCar ? [element("div", "body")] : []), ...drive.wheels.map((one) => tileOf(isCar ? one : { ...one, place: null })));
  };
  // One choice for every screen of the session.
  const showUnits = (units, names) => {
    const select = byId("units");
    if (!select.options.length) select.append(...Object.entries(names).map(([value, text]) => new Option(text, value)));
    if (select.dataset.units !== units) { select.dataset.units = units; select.value = units; }
  };
  const setFace = (chosen) => {
    face = chosen;
    for (const id of ["drive", "drive-speed"]) byId(id).hidden = face !== "drive";
    document.querySelector("main").hidden = face === "drive";
    for (const name of ["drive", "engineer"]) byId(`to-${name}`).setAttribute("aria-pressed", String(face === name));
    setTheme(themeChosen || (face === "drive" || dark.matches ? "dark" : "light"));
  };
  const showWheels = (wheels) => {
    const box = byId("wheels");
    while (box.children.length > wheels.length) box.lastChild.remove();
    wheels.forEach((one, i) => {
      let card = box.children[i];
      if (!card) {
        card = element("button", "wheel");
        card.type = "button";
        const top = element("span", "top");
        top.append(element("span", "name"), element("span", "kind"), element("span", "flag"));
        card.append(top, element("span", "speed"));
        for (const part of ["tiles", "edges", "car", "note"]) card.append(element("div", part));
        card.addEventListener("click", () => choose(card.dataset.wheel));
        box.append(card);
      }
      const part = (name) => card.querySelector(`.${name}`);
      card.dataset.wheel = one.key;
      card.className = `wheel ${one.kind} ${one.alarm ? "alarm" : ""}`;
      card.setAttribute("aria-pressed", String(one.key === wheel));
      setText(part("name"), one.position);
      setText(part("kind"), one.state);
      setText(part("flag"), one.alarm ? "ALARM" : "");
      const [value, error, unit, mark] = one.speed;
      const speed = part("speed"), key = one.speed.join();
      if (speed.dataset.key !== key) {
        speed.dataset.key = key;
        speed.replaceChildren(value, element("small", "", `${unit} ${mark}`), element("small", "", error ? `± ${error}` : ""));
      }
      setRuns(part("tiles"), one.surroundings);
      setRuns(part("edges"), one.edges.map((text) => [text, ""]));
      setRuns(part("car"), one.car.length ? [["car", "label"], ...one.car] : []);
      setText(part("note"), one.note ? one.note[0] : "");
      part("note").className = `note ${one.note ? one.note[1] : ""}`;
      if (one.key === wheel) showNumbers(one);
    });
  };
  const showNumbers = (one) => {
    setText(byId("numbers-title"), `Numbers and sensor health: ${one.position}`);
    setRuns(byId("health"), one.counters);
    setRows(byId("flags"), one.flags);
    const body = byId("numbers");
    while (body.children.length > one.numbers.length) body.lastChild.remove();
    one.numbers.forEach(([label, value, error, unit, mark, reason], i) => {
      if (!body.children[i]) {
        const row = element("tr"), head = element("th");
        head.scope = "row";
        row.append(head, element("td", "value"), element("td"));
        body.append(row);
      }
      const [head, number, why] = body.children[i].children;
      setText(head, label);
      setText(number, `${value}${error ? ` ± ${error}` : ""} ${unit}`);
      setText(why, [{ "~": "provisional", x: "invalid" }[mark], reason].filter(Boolean).join(": "));
    });
  };
  const choose = (key) => {
    wheel = key;
    waveform = null;
    ask({ wheel });
    if (state) showWheels(state.wheels);
    showWaveform();
  };

  // Plots

  const plot = (id, key, data, makeOptions) => {
    const box = byId(id);
    const width = Math.max(box.clientWidth, 200), height = Math.max(180, Math.min(340, Math.round(width * 0.5)));
    const known = plots[id];
    if (known && known.key === key && known.width === width) { known.uplot.setData(data); return; }
    if (known) known.uplot.destroy();
    const options = makeOptions(pictures.axis());
    plots[id] = { key, width, uplot: new uPlot({ width, height, legend: { show: false }, ...options }, data, box) };
  };
  // The values at the cursor, in words below the picture.
  const reading = (target, nameOf, names) => (u) => {
    const { idx } = u.cursor, values = names.map((name, i) => [name, idx == null ? null : u.data[i + 1][idx]]);
    const text = values.map(([name, value]) => `${name} ${value == null ? "—" : Number(value.toPrecision(4))}`).join(", ");
    setText(byId(target), idx == null ? "" : `${nameOf(u.data[0][idx])}: ${text} m/s²`);
  };
  const clearPlot = (id) => { if (plots[id]) { plots[id].uplot.destroy(); delete plots[id]; } };
  const themeKey = () => document.documentElement.dataset.theme;

  const showWaveform = () => {
    if (!waveform) {
      clearPlot("waveform");
      clearPlot("orders");
      setText(byId("waveform-note"), "no current revolution");
      return;
    }
    const name = (state && state.wheels.find((one) => one.key === wheel) || { position: wheel }).position;
    const { angle_deg: angle, last_mps2: last, average_mps2: average, scatter_mps2: scatter, edges_deg: edges } = waveform;
    const part = (sign) => average.map((value, i) => (scatter[i] == null ? null : value + sign * scatter[i]));
    const text = `${name}, revolution ${waveform.revolution}: solid last, dashed average with its scatter from revolution to revolution`;
    setText(byId("waveform-note"), text);
    byId("waveform").setAttribute("aria-label", text);
    plot("waveform", `${themeKey()}`, [angle, last, average, part(1), part(-1)], (axis) => ({
      scales: { x: { time: false } },
      axes: [{ ...axis, values: (_, ticks) => ticks.map((tick) => `${tick}°`) }, { ...axis, size: pictures.widthFrom(62), label: "m/s²", labelSize: 18 }],
      cursor: { drag: { x: false, y: false } },
      series: [{}, { stroke: css("--ink"), width: 2 }, { stroke: css("--pick"), width: 2, dash: [6, 4] }, { stroke: "transparent" }, { stroke: "transparent" }],
      bands: [{ series: [3, 4], fill: faint(css("--pick")) }],
      hooks: { setCursor: [reading("waveform-read", (x) => `${x.toFixed(1)}°`, ["last", "average"])], draw: [(u) => {
        u.ctx.save();
        u.ctx.strokeStyle = css("--warn");
        u.ctx.setLineDash([3, 3]);
        for (const edge of waveform ? waveform.edges_deg : edges) {
          if (edge == null) continue;
          const x = Math.round(u.valToPos(edge, "x", true));
          u.ctx.beginPath();
          u.ctx.moveTo(x, u.bbox.top);
          u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
          u.ctx.stroke();
        }
        u.ctx.restore();
      }] },
    }));
    const positive = (values) => values.slice(1).map((value) => (value > 0 ? value : null));
    const orders = [waveform.orders_mps2.slice(1).map((_, i) => i + 1), positive(waveform.average_orders_mps2), positive(waveform.orders_mps2)];
    byId("orders").setAttribute("aria-label", `${name}: magnitude of orders 1 to ${orders[0].length}, bars average, points last revolution`);
    plot("orders", `${themeKey()}`, orders, (axis) => ({
      scales: { x: { time: false }, y: { distr: 3 } },
      cursor: { drag: { x: false, y: false } },
      hooks: { setCursor: [reading("orders-read", (x) => `order ${x}`, ["average", "last"])] },
      axes: [{ ...axis, label: "order", labelSize: 18 }, { ...axis, size: pictures.widthFrom(62), label: "m/s²", labelSize: 18 }],
      series: [{}, { stroke: css("--pick"), fill: faint(css("--pick")), width: 1, paths: uPlot.paths.bars({ size: [0.7, 20] }), points: { show: false } },
        { stroke: css("--ink"), paths: () => null, points: { show: true, size: 5, fill: css("--ink") } }],
    }));
  };

  // Trends

  const showQuantities = (found) => {
    quantities = found;
    const select = byId("quantity");
    select.replaceChildren(...found.map((one) => {
      const option = element("option", "", `${one.label}${one.unit ? ` (${one.unit})` : ""}${one.description ? `: ${one.description}` : ""}`);
      option.value = one.name;
      return option;
    }));
    select.value = quantity;
  };
  const mergeTrend = (message) => {
    for (const [position, added] of Object.entries(message.wheels)) {
      const kept = (points.get(position) || []).filter(([at]) => at < message.since_s);
      points.set(position, [...kept, ...added]);
    }
    const latest = Math.max(...[...points.values()].flat().map(([at]) => at));
    for (const [position, kept] of points) points.set(position, kept.filter(([at]) => at >= latest - SPAN_S));
    showTrend();
  };
  // Wheels that are left out of the trend, and the times that are shown of it: null follows the latest.
  const absent = new Set();
  let zoomed = null, writeTrend = () => {};
  const zoom = (range) => { zoomed = range; byId("latest").setAttribute("aria-pressed", String(!zoomed)); showTrend(); };
  const scaleTrend = (factor, shift) => {
    const every = [...points.values()].flat().map(([at]) => at);
    if (!every.length) return;
    const first = Math.min(...every), last = Math.max(...every);
    const [begin, end] = zoomed || [Math.max(first, last - 60 * Number(byId("minutes").value)), last];
    const half = Math.max(2, (factor * (end - begin)) / 2), middle = (begin + end) / 2 + shift * (end - begin);
    zoom([Math.max(first, Math.round(middle - half)), Math.min(last, Math.round(middle + half))]);
  };
  const showTrend = () => {
    const shown = quantities.find((one) => one.name === quantity) || { label: "Trend", unit: "" };
    // A wheel keeps its colour, whichever quantities it has.
    const wheels = [...points.keys()].sort(), styleOf = (position) => wheels.indexOf(position);
    const present = wheels.filter((position) => points.get(position).length);
    const positions = present.filter((position) => !absent.has(position));
    const every = present.flatMap((position) => points.get(position).map(([at]) => at));
    setText(byId("trend-note"), every.length
      ? `${shown.label}: last revolution of each second, band one standard error, dotted provisional`
      : `${shown.label}: no value yet`);
    if (!present.length) { clearPlot("trend"); byId("trend-legend").replaceChildren(); return; }
    const last = Math.max(...every), end = zoomed ? zoomed[1] : last;
    const begin = zoomed ? zoomed[0] : end - 60 * Number(byId("minutes").value);
    const start = Math.max(begin, Math.min(...every, end));
    const times = Array.from({ length: end - start + 1 }, (_, i) => start + i);
    const data = [times], known = new Map();
    positions.forEach((position) => {
      const ofWheel = new Map(points.get(position).map((point) => [point[0], point]));
      known.set(position, ofWheel);
      const columns = [[], [], [], []];
      let heard = -Infinity;
      for (const at of times) {
        const point = ofWheel.get(at);
        if (point) {
          // A gap that is too short for silence is drawn through; uPlot breaks lines at null only.
          if (at - heard <= GAP_S) for (let back = 1; back < at - heard; back += 1) for (const column of columns) column[column.length - back] = undefined;
          heard = at;
        }
        const [, value, error, isProvisional] = point || [at, null, null, 0];
        pictures.cellsOf(value, error, isProvisional).forEach((cell, i) => columns[i].push(cell));
      }
      data.push(...columns);
    });
    // Of each wheel the value at the cursor, else the last one; a click leaves the wheel out.
    const texts = (time) => present.map((position) => {
      const [at, value, error, isProvisional] = time === null ? points.get(position).at(-1) : (known.get(position) || new Map()).get(time) || [time, null];
      if (absent.has(position)) return [position, `${position}: left out`, false];
      if (value === null) return [position, `${position}: —`, false];
      const isOld = time === null && last - at > GAP_S;
      return [position, `${position}: ${isOld ? `none for ${last - at} s` : pictures.written(value, error, shown.unit, isProvisional, quantity)}`, isProvisional];
    });
    const legend = byId("trend-legend");
    while (legend.children.length > present.length) legend.lastChild.remove();
    const write = (time) => texts(time).forEach(([position, text, isProvisional], i) => {
      if (!legend.children[i]) {
        const item = element("li"), button = element("button");
        button.type = "button";
        button.addEventListener("click", () => {
          const { wheel: of } = button.dataset;
          if (!absent.delete(of)) absent.add(of);
          showTrend();
        });
        item.append(button);
        legend.append(item);
      }
      const button = legend.children[i].firstChild;
      button.dataset.wheel = position;
      button.setAttribute("aria-pressed", String(!absent.has(position)));
      button.replaceChildren(pictures.key(styleOf(position), isProvisional ? pictures.DOTTED : []), text);
    });
    writeTrend = write;
    write(null);
    byId("trend").setAttribute("aria-label", `trend of ${shown.label}: ${legend.innerText}`);
    if (!positions.length) { clearPlot("trend"); return; }
    plot("trend", `${themeKey()} ${quantity} ${positions.join("\n")}`, data, (axis) => ({
      axes: [
        { ...axis, space: 80, values: (_, ticks) => ticks.map((at) => new Date(1000 * at).toLocaleTimeString([], { hour12: false })) },
        { ...axis, size: pictures.widthFrom(62), label: shown.unit || shown.label, labelSize: 18 },
      ],
      cursor: { drag: { x: true, y: false, setScale: false } },
      hooks: {
        setCursor: [(u) => writeTrend(u.cursor.idx == null ? null : u.data[0][u.cursor.idx])],
        setSelect: [(u) => {
          const { left, width } = u.select;
          if (width > 3) zoom([u.posToVal(left, "x"), u.posToVal(left + width, "x")].map(Math.round));
          if (width) u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        }],
      },
      series: [{}, ...positions.flatMap((position) => pictures.seriesOf(styleOf(position)))],
      bands: pictures.bandsOf(positions.map(styleOf)),
    }));
    const { idx } = plots.trend.uplot.cursor;
    if (idx != null) write(times[idx]);
  };

  // What the user does

  byId("marks").addEventListener("submit", (event) => {
    event.preventDefault();
    if (want({ mark: byId("mark-text").value })) byId("mark-text").value = "";
  });
  byId("acknowledge").addEventListener("click", () => want({ acknowledge: true }));
  const run = byId("run");
  byId("record").addEventListener("click", (event) => {
    if (event.currentTarget.dataset.on === "true") return want({ record: false });
    for (const [name, text] of Object.entries(state.run)) run.elements[name].value = text;
    run.hidden = !run.hidden;
    return run.elements.test.focus();
  });
  run.addEventListener("reset", () => { run.hidden = true; });
  run.addEventListener("submit", (event) => {
    event.preventDefault();
    run.hidden = true;
    want({ record: true, run: Object.fromEntries(new FormData(run)) });
  });
  byId("quantity").addEventListener("change", (event) => { quantity = event.currentTarget.value; askForTrend(); });
  byId("minutes").addEventListener("change", () => zoom(null));
  for (const [id, factor, shift] of [["zoom-in", 0.5, 0], ["zoom-out", 2, 0], ["earlier", 1, -0.5], ["later", 1, 0.5]]) {
    byId(id).addEventListener("click", () => scaleTrend(factor, shift));
  }
  byId("latest").addEventListener("click", () => zoom(null));
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const setTheme = (theme) => {
    document.documentElement.dataset.theme = theme;
    document.documentElement.style.colorScheme = theme;
    showWaveform();
    showTrend();
  };
  let themeChosen = "";
  dark.addEventListener("change", () => setFace(face));
  byId("theme").addEventListener("click", () => { themeChosen = themeKey() === "dark" ? "light" : "dark"; setTheme(themeChosen); });
  for (const name of ["drive", "engineer"]) byId(`to-${name}`).addEventListener("click", () => { store("face", name); setFace(name); });
  byId("units").addEventListener("change", (event) => ask({ units: event.currentTarget.value }));
  addEventListener("resize", () => { showWaveform(); showTrend(); });
  setFace(face);
  setInterval(watch, 500);
  connect();
})();
