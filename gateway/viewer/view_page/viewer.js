"use strict";
(() => {
  const { element, clock } = DriveSection, byId = (id) => document.getElementById(id);
  const AXES = ["circumferential", "lateral", "radial"], UNIT = "m/s²", ORDERS = 61, RETRY_MS = 1000, STATE_MS = 700;
  const OVERVIEW_HEIGHT = 110, SAMPLES_HEIGHT = 240, ORDERS_HEIGHT = 320, SHORTEST_S = 0.0005, STOP_S = 2.5;
  const PALETTE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

  // Questions and answers

  let socket = null, lastId = 0;
  const waiting = new Map();
  const ask = (what) => new Promise((resolve, reject) => {
    if (!socket || socket.readyState !== WebSocket.OPEN) return reject(new Error("The program has ended, or cannot be reached."));
    const id = (lastId += 1);
    waiting.set(id, { resolve, reject });
    return socket.send(JSON.stringify({ id, ...what }));
  });
  const say = (text, isFault = false) => {
    byId("status").className = isFault ? "fault" : "";
    if (byId("status").textContent !== text) byId("status").textContent = text;
  };
  const failed = (error) => say(error.message, true);
  // The newest of one kind of question: one at a time, the next when it is answered.
  const newest = (work) => {
    let isRunning = false, isAgain = false;
    const run = async () => {
      if (isRunning) { isAgain = true; return; }
      isRunning = true;
      do {
        isAgain = false;
        try { await work(); } catch (error) { failed(error); }
      } while (isAgain);
      isRunning = false;
    };
    return run;
  };
  const connect = () => {
    socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/#.*/, ""));
    socket.addEventListener("open", () => refresh());
    socket.addEventListener("message", (event) => {
      const answer = JSON.parse(event.data), one = waiting.get(answer.id);
      waiting.delete(answer.id);
      if (!one) return;
      if (answer.error) one.reject(new Error(answer.error)); else one.resolve(answer);
    });
    socket.addEventListener("close", () => {
      for (const one of waiting.values()) one.reject(new Error("The program has ended, or cannot be reached."));
      waiting.clear();
      setTimeout(connect, RETRY_MS);
    });
  };

  // What there is

  let recordings = [], series = [], section = null, overview = null;
  let samples = [], whole = [], pictured = [], moment = null, samplePlots = [], wavePlots = [], ordersPlot = null;
  const shownAxes = new Set([2]), hidden = new Set();
  const nameOf = (one) => (recordings.length > 1 ? `${recordings[one.recording].name} ${one.wheel}` : one.wheel);
  const visible = () => series.map((one, i) => i).filter((i) => !hidden.has(i));

  const refresh = newest(async () => {
    const state = await ask({ ask: "state" });
    recordings = state.recordings;
    byId("title").textContent = recordings.map((one) => one.name).join(", ");
    document.title = `${byId("title").textContent} – treadlink view`;
    const before = series.length;
    recordings.forEach((one, recording) => one.wheels.forEach((wheel) => {
      if (!series.some((known) => known.recording === recording && known.wheel === wheel)) series.push({ recording, wheel });
    }));
    if (!section) start();
    if (series.length !== before) showChoices();
    const busy = recordings.filter((one) => one.stage && !one.fault);
    const faults = recordings.filter((one) => one.fault).map((one) => `${one.name}: ${one.fault}`);
    say(faults.join(" ") || busy.map((one) => `${one.name}: ${one.stage}, ${Math.floor(100 * one.share)} %`).join("; "), faults.length > 0);
    for (const [i, one] of recordings.entries()) if (one.has_pictures && !pictured[i]) {
      pictured[i] = (await ask({ ask: "pictures", recording: i })).pictures;
      showPictures();
    }
    load();
    loadWhole();
    loadOrders();
    if (busy.length) setTimeout(refresh, STATE_MS);
  });

  const start = () => {
    const end = Math.max(...recordings.map((one) => one.span));
    section = new DriveSection(byId("view-pictures"), { wheels: [], quantities: [], events: [], waveforms: [], first: [] }, {
      whole: [0, end], shortest: SHORTEST_S, onZoom: () => { load(); loadOrders(); if (overview) overview.redraw(); }, onMoment: (time) => showMoment({ time }),
    });
    section.box.insertBefore(element("div"), section.grid).id = "samples";
  };

  const option = (value, text) => { const made = element("option", "", text); made.value = value; return made; };
  const box = (label, isOn, act, key) => {
    const made = element("label"), input = element("input");
    Object.assign(input, { type: "checkbox", checked: isOn });
    input.addEventListener("change", () => act(input.checked));
    made.append(input, ...(key ? [key] : []), label);
    return made;
  };
  const keyOf = (i) => pictures.key(i, pictures.dashOf(i));
  const showChoices = () => {
    byId("wheels").replaceChildren(byId("wheels").firstElementChild, ...series.map((one, i) => box(nameOf(one), !hidden.has(i), (isOn) => {
      if (isOn) hidden.delete(i); else hidden.add(i);
      drawAll();
    }, keyOf(i))));
    byId("axes").replaceChildren(byId("axes").firstElementChild, ...AXES.map((name, axis) => box(name, shownAxes.has(axis), (isOn) => {
      if (isOn) shownAxes.add(axis); else shownAxes.delete(axis);
      drawAll();
    })));
    for (const id of ["focus", "orders-wheel"]) {
      const chosen = byId(id).value || "0";
      byId(id).replaceChildren(...series.map((one, i) => option(String(i), nameOf(one))));
      byId(id).value = chosen;
    }
    byId("orders-axis").replaceChildren(...[2, 0, 1].map((axis) => option(String(axis), AXES[axis])));
  };

  // A picture that is drawn anew under the mouse loses its drag or click: what comes meanwhile is drawn after it.
  let isPressed = false;
  const postponed = new Map();
  const undisturbed = (draw) => (...data) => { if (isPressed) postponed.set(draw, data); else draw(...data); };
  for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) addEventListener(type, (event) => {
    isPressed = type === "pointerdown" || (type === "pointermove" && isPressed && event.buttons !== 0);
    if (isPressed || !postponed.size) return;
    const due = [...postponed];
    postponed.clear();
    // Behind the click that this release makes.
    setTimeout(() => { for (const [draw, data] of due) undisturbed(draw)(...data); });
  }, true);

  // Quantities, events, and the first sentence: as on the page of a drive

  const showPictures = undisturbed(() => {
    const wheels = series.map((channel) => {
      const drive = pictured[channel.recording], index = drive ? drive.wheels.findIndex((wheel) => wheel.name === channel.wheel) : -1;
      return { drive, index, name: nameOf(channel), t: index < 0 ? [] : drive.wheels[index].t };
    });
    const names = [...new Set(pictured.filter(Boolean).flatMap((one) => one.quantities.map((quantity) => quantity.name)))];
    const quantities = names.map((name) => {
      const matching = wheels.map(({ drive }) => drive && drive.quantities.find((quantity) => quantity.name === name));
      const { label, unit } = matching.find(Boolean);
      return { name, label, unit, wheels: wheels.map(({ index }, i) => (matching[i] && index >= 0 ? matching[i].wheels[index] : null)) };
    });
    const events = pictured.flatMap((one, i) => (one ? one.events.map((event) => ({ ...event, recording: recordings[i].name })) : []));
    const first = ["speed_mps", "pressure_pa"].filter((name) => names.includes(name));
    section.take({ wheels: wheels.map(({ name, t }) => ({ name, t })), quantities, events, waveforms: [], first });
    byId("verdicts").replaceChildren(...recordings.flatMap((_, i) => {
      const one = pictured[i];
      if (!one) return [element("p", "small", `${recordings[i].name}: the verdict comes when its revolutions are estimated.`)];
      const said = element("p", one.actions.length ? "answer act" : "answer", recordings.length > 1 ? `${recordings[i].name}: ${one.summary}` : one.summary);
      const todo = element("ul"), happened = element("ul", "events");
      todo.append(...one.actions.map(([about, step]) => element("li", "", `${about}: ${step}`)));
      happened.append(...one.events.map((event) => {
        const row = element("li", event.kind), end = event.end === null ? " to the end" : event.end > event.begin ? ` to ${clock(event.end)}` : "", go = element("button", "", `${clock(event.begin)}${end}`);
        go.type = "button";
        go.addEventListener("click", () => { section.zoom([event.begin - 15, (event.end === null ? event.begin : event.end) + 15]); });
        row.append(go, `${event.wheel} ${event.text}`);
        return row;
      }));
      return [said, ...(one.actions.length ? [element("h3", "", "What to do"), todo] : []), ...(one.events.length ? [element("h3", "", "What happened"), happened] : [])];
    }));
    section.draw();
    drawSamples();
  });

  // Samples

  const load = newest(async () => {
    const [begin, end] = section.range, columns = Math.max(200, Math.min(2000, byId("view-pictures").clientWidth));
    const answers = [];
    for (const i of recordings.keys()) answers.push(begin < recordings[i].span ? (await ask({ ask: "samples", recording: i, begin, end, columns })).wheels : {});
    samples = answers;
    drawSamples();
  });
  const loadWhole = newest(async () => {
    const [begin, end] = section.whole, answers = [];
    for (const i of recordings.keys()) answers.push((await ask({ ask: "samples", recording: i, begin, end, columns: 600 })).wheels);
    whole = answers;
    drawOverview();
  });
  const partOf = (answers, i) => (answers[series[i].recording] || {})[series[i].wheel];
  // One axis of time for all; undefined is drawn through, null is a gap.
  const columnsOf = (answers, shown, axis) => {
    const parts = shown.map((i) => partOf(answers, i));
    const times = [...new Set(parts.flatMap((part) => (part ? part.t : [])))].sort((a, b) => a - b);
    const index = new Map(times.map((time, at) => [time, at]));
    const data = [times];
    for (const part of parts) {
      const low = new Array(times.length).fill(undefined), high = new Array(times.length).fill(undefined);
      if (part) {
        let previous = null;
        part.t.forEach((time, at) => {
          const row = index.get(time);
          low[row] = part.low[axis][at];
          high[row] = part.high[axis][at];
          if (previous !== null && (low[row] === null || low[previous] === null)) for (const column of [low, high]) column.fill(null, previous + 1, row);
          previous = row;
        });
      }
      data.push(low, high);
    }
    return data;
  };
  const isSingle = (answers, i) => { const part = partOf(answers, i); return Boolean(part) && part.t.length > 0 && part.low.every((axis, a) => axis.every((value, at) => value === part.high[a][at])); };
  // Times from the last sample before a loss, or before the part that is shown, to the first one behind it.
  const missingOf = ({ t, low, lost }) => lost.map(([at]) => {
    const behind = t.findIndex((time) => time >= at - 0.001);
    let before = behind - 1;
    while (before >= 0 && low.every((axis) => axis[before] === null)) before -= 1;
    return [before < 0 ? -Infinity : t[before], at];
  });
  const lossesOn = (answers) => (u) => {
    u.ctx.save();
    u.ctx.fillStyle = pictures.css("--alarm");
    for (const i of visible()) {
      const part = partOf(answers(), i);
      for (const span of part ? missingOf(part) : []) {
        const [from, to] = span.map((at) => Math.min(Math.max(u.valToPos(at, "x", true), u.bbox.left), u.bbox.left + u.bbox.width));
        if (to > u.bbox.left && from < u.bbox.left + u.bbox.width) u.ctx.fillRect(from, u.bbox.top + u.bbox.height - 8 * devicePixelRatio, Math.max(2 * devicePixelRatio, to - from), 8 * devicePixelRatio);
      }
    }
    if (moment) {
      u.ctx.fillStyle = `${pictures.css("--after")}55`;
      const from = u.valToPos(moment.begin, "x", true), to = u.valToPos(moment.end, "x", true);
      if (to >= u.bbox.left && from <= u.bbox.left + u.bbox.width) u.ctx.fillRect(Math.max(from, u.bbox.left), u.bbox.top, Math.max(2, Math.min(to, u.bbox.left + u.bbox.width) - Math.max(from, u.bbox.left)), u.bbox.height);
    }
    u.ctx.restore();
  };
  const seriesOf = (answers, shown) => shown.flatMap((i) => {
    const stroke = pictures.colourOf(i), isPoint = isSingle(answers, i) && partOf(answers, i).t.length < 300;
    return [{ stroke, width: 1, points: { show: isPoint, size: 5, fill: stroke, stroke } }, { stroke, width: 1, points: { show: false } }];
  });
  const bandsOf = (shown) => shown.map((i, at) => ({ series: [2 * at + 2, 2 * at + 1], fill: pictures.faint(pictures.colourOf(i)) }));
  const written = (value) => (value == null ? "—" : value.toFixed(1));
  const readout = (shown, axis, legend) => (u) => {
    const cursor = u.cursor.idx == null ? null : u.data[0][u.cursor.idx];
    legend.replaceChildren(...shown.map((i) => {
      const part = partOf(samples, i), item = element("li");
      item.append(keyOf(i), nameOf(series[i]));
      if (cursor !== null && part && part.t.length) {
        let row = part.t.findIndex((time) => time >= cursor - 1e-9);
        if (row < 0) row = part.t.length - 1;
        const low = part.low[axis][row], high = part.high[axis][row];
        item.append(`: ${low === high ? written(low) : `${written(low)} to ${written(high)}`} ${UNIT} at ${clock(part.t[row], low === high ? 0.0001 : 0.01)}`);
      }
      return item;
    }));
  };
  const drawSamples = undisturbed(() => {
    const shown = visible(), holder = byId("samples");
    for (const { plot } of samplePlots) plot.destroy();
    section.added = section.added.filter((plot) => plot === ordersPlot);
    samplePlots = [...shownAxes].sort((a, b) => b - a).map((axis) => {
      const figure = element("figure"), inner = element("div"), legend = element("ul", "legend");
      figure.append(element("div", "picture-title", `${AXES[axis]} axis, ${UNIT}`), inner, legend);
      inner.setAttribute("role", "img");
      inner.setAttribute("aria-label", `samples of the ${AXES[axis]} axis over time of ${shown.map((i) => nameOf(series[i])).join(", ")}`);
      const read = readout(shown, axis, legend);
      const plot = section.overTime(inner, columnsOf(samples, shown, axis), {
        series: seriesOf(samples, shown), bands: bandsOf(shown), height: SAMPLES_HEIGHT, draw: [lossesOn(() => samples)],
      }, read);
      read(plot);
      section.added.push(plot);
      return { plot, figure };
    });
    holder.replaceChildren(...samplePlots.map(({ figure }) => figure));
    section.resize();
    holder.dataset.range = section.range.join(" ");
  });
  const drawOverview = undisturbed(() => {
    const shown = visible(), holder = byId("overview"), inner = element("div");
    if (overview) overview.destroy();
    holder.replaceChildren(inner);
    const range = section.range;
    section.range = section.whole;
    overview = section.overTime(inner, columnsOf(whole, shown, 2), {
      series: seriesOf(whole, shown), bands: bandsOf(shown), height: OVERVIEW_HEIGHT,
      draw: [lossesOn(() => whole), (u) => {
        const from = u.valToPos(section.range[0], "x", true), to = u.valToPos(section.range[1], "x", true);
        u.ctx.save();
        u.ctx.strokeStyle = pictures.css("--ink");
        u.ctx.lineWidth = 2 * devicePixelRatio;
        u.ctx.strokeRect(from, u.bbox.top, Math.max(2, to - from), u.bbox.height);
        u.ctx.restore();
      }],
    });
    section.range = range;
    overview.setSize({ width: Math.max(holder.clientWidth, 200), height: OVERVIEW_HEIGHT });
  });

  // A revolution

  let asked = 0;
  const showMoment = async ({ time, number }) => {
    const mine = (asked += 1), focus = Number(byId("focus").value || 0);
    byId("revolution-note").textContent = "reading …";
    try {
      const channel = series[focus], first = await ask({ ask: "revolution", recording: channel.recording, wheel: channel.wheel, ...(number === undefined ? { time } : { number }) });
      if (mine !== asked) return;
      const shown = first.revolution;
      if (!shown) { byId("revolution-note").textContent = `${nameOf(channel)}: no revolution near ${clock(time, 0.01)}.`; return; }
      moment = shown;
      const middle = (shown.begin + shown.end) / 2, revolutions = [[focus, shown]];
      for (const i of visible()) if (i !== focus && middle < recordings[series[i].recording].span) {
        const { revolution } = await ask({ ask: "revolution", recording: series[i].recording, wheel: series[i].wheel, time: middle });
        if (mine !== asked) return;
        if (revolution && revolution.begin <= shown.end && revolution.end >= shown.begin) revolutions.push([i, revolution]);
      }
      byId("number").value = shown.number === null ? "" : String(shown.number);
      byId("revolution-note").textContent = revolutions.map(([i, revolution]) =>
        `${nameOf(series[i])}: ${revolution.number === null ? "revolution" : `revolution ${revolution.number}`} at ${clock(revolution.begin, 0.001)}, ${revolution.speed_kmh} km/h${revolution.faults ? ` (${revolution.faults})` : ""}`).join("; ");
      drawWaveforms(revolutions);
      if (shown.end < section.range[0] || shown.begin > section.range[1]) section.scale(1, (middle - (section.range[0] + section.range[1]) / 2) / (section.range[1] - section.range[0]));
      for (const { plot } of samplePlots) plot.redraw();
    } catch (error) { failed(error); }
  };
  const drawWaveforms = (revolutions) => {
    for (const plot of wavePlots) plot.destroy();
    const axis = pictures.axis();
    const angles = [...new Set(revolutions.flatMap(([, revolution]) => revolution.angle))].sort((a, b) => a - b), index = new Map(angles.map((angle, i) => [angle, i]));
    const figures = [...shownAxes].sort((a, b) => b - a).map((number) => {
      const figure = element("figure"), inner = element("div"), legend = element("ul", "legend");
      figure.append(element("div", "picture-title", `${AXES[number]} axis, ${UNIT}, over the angle`), inner, legend);
      inner.setAttribute("role", "img");
      inner.setAttribute("aria-label", `waveform of the ${AXES[number]} axis over the angle: ${byId("revolution-note").textContent}`);
      legend.append(...revolutions.map(([i]) => { const item = element("li"); item.append(keyOf(i), nameOf(series[i])); return item; }));
      const columns = revolutions.map(([, revolution]) => {
        const column = new Array(angles.length).fill(undefined);
        revolution.angle.forEach((angle, row) => { column[index.get(angle)] = revolution.axes[number][row]; });
        return column;
      });
      return { figure, make: () => new uPlot({
        width: Math.max(inner.clientWidth, 200), height: SAMPLES_HEIGHT, legend: { show: false },
        cursor: { drag: { x: true, y: false } },
        scales: { x: { time: false } },
        axes: [{ ...axis, values: (_, ticks) => ticks.map((tick) => `${tick}°`) }, { ...axis, size: pictures.widthFrom(58) }],
        series: [{}, ...revolutions.map(([i]) => ({ stroke: pictures.colourOf(i), width: 1.5, dash: pictures.dashOf(i), points: { show: false } }))],
        hooks: { draw: [(u) => {
          u.ctx.save();
          u.ctx.setLineDash([3, 3]);
          for (const [i, revolution] of revolutions) for (const edge of revolution.edges) if (edge !== null) {
            u.ctx.strokeStyle = pictures.colourOf(i);
            u.ctx.beginPath();
            u.ctx.moveTo(u.valToPos(edge, "x", true), u.bbox.top);
            u.ctx.lineTo(u.valToPos(edge, "x", true), u.bbox.top + u.bbox.height);
            u.ctx.stroke();
          }
          u.ctx.restore();
        }] },
      }, [angles, ...columns], inner) };
    });
    byId("waveforms").replaceChildren(...figures.map(({ figure }) => figure));
    wavePlots = figures.map(({ make }) => make());
  };
  const step = (by) => {
    const number = byId("number").value;
    if (number !== "") showMoment({ number: Math.max(0, Number(number) + by) });
    else if (moment) showMoment({ time: by > 0 ? moment.end + 0.3 * (moment.end - moment.begin) : moment.begin - 0.3 * (moment.end - moment.begin) });
  };

  // Orders

  let ordersKey = "";
  const loadOrders = newest(async () => {
    if (!series.length) return;
    const one = series[Number(byId("orders-wheel").value || 0)], axis = Number(byId("orders-axis").value || 2), over = byId("over").value, [begin, end] = section.range;
    const key = [one.recording, one.wheel, axis, over, ...(over === "speed" || end - begin > 20 ? ["whole"] : [begin, end]), Math.floor(10 * recordings[one.recording].share), recordings[one.recording].stage].join("\n");
    if (key === ordersKey) return;
    drawOrders(await ask({ ask: "orders", recording: one.recording, wheel: one.wheel, axis, over, begin, end }), one, axis, over);
    ordersKey = key;
  });
  const colour = (share) => {
    const position = Math.min(Math.max(share, 0), 0.9999) * (PALETTE.length - 1), low = PALETTE[Math.floor(position)], high = PALETTE[Math.floor(position) + 1];
    return `rgb(${low.map((value, i) => Math.round(value + (position % 1) * (high[i] - value))).join(",")})`;
  };
  const drawOrders = undisturbed(({ x, width, orders }, one, axis, over) => {
    section.added = section.added.filter((plot) => plot !== ordersPlot);
    if (ordersPlot) { ordersPlot.destroy(); ordersPlot = null; }
    const holder = byId("orders"), note = byId("orders-note"), label = `${nameOf(one)}, ${AXES[axis]} axis, orders over ${over}`;
    holder.setAttribute("role", "img");
    holder.setAttribute("aria-label", label);
    if (!x.length) { note.textContent = `${label}: no revolution so far.`; return; }
    const logs = orders.map((row) => row.map((value) => (value > 0 ? Math.log10(value) : null)));
    const sorted = logs.flat().filter((value) => value !== null).sort((a, b) => a - b);
    const low = sorted[Math.floor(0.02 * sorted.length)], high = sorted[Math.floor(0.998 * (sorted.length - 1))], span = Math.max(high - low, 0.01);
    const brief = (value) => (value >= 100 ? value.toFixed(0) : value.toPrecision(2));
    const legend = `${label}. Dark ${brief(10 ** low)} to yellow ${brief(10 ** high)} ${UNIT}.`;
    note.textContent = legend;
    // Over time a column reaches back to the one before, as a revolution may take longer than a column; a stop is a gap.
    const edge = (i) => (over === "speed" || !i || x[i] - x[i - 1] > STOP_S ? [x[i] - (width || 0.1) / 2, x[i] + width / 2] : [x[i - 1] + width / 2, x[i] + width / 2]);
    const paint = (u) => {
      const { left, top, width: across, height } = u.bbox, y = (order) => u.valToPos(order, "y", true);
      u.ctx.save();
      u.ctx.beginPath();
      u.ctx.rect(left, top, across, height);
      u.ctx.clip();
      logs.forEach((row, i) => {
        const [from, to] = edge(i).map((value) => u.valToPos(value, "x", true));
        if (to < left || from > left + across) return;
        row.forEach((value, order) => {
          if (value === null) return;
          u.ctx.fillStyle = colour((value - low) / span);
          u.ctx.fillRect(from, y(order + 0.5), Math.max(1, to - from + 0.5), y(order - 0.5) - y(order + 0.5) + 0.5);
        });
      });
      u.ctx.restore();
    };
    const read = (u) => {
      if (u.cursor.idx == null || u.cursor.top < 0) { note.textContent = legend; return; }
      const order = Math.min(Math.max(Math.round(u.posToVal(u.cursor.top, "y")), 0), ORDERS - 1), i = u.cursor.idx, value = orders[i][order];
      note.textContent = `Order ${order} ${over === "speed" ? `at ${x[i].toFixed(1)} km/h` : `at ${clock(x[i], 0.01)}`}: ${value === null ? "—" : value.toPrecision(3)} ${UNIT}.`;
    };
    const none = [{ stroke: "transparent", points: { show: false } }], y = { range: [-0.5, ORDERS - 0.5] }, data = [x, x.map(() => 0)];
    if (over === "time") {
      ordersPlot = section.overTime(holder, data, { series: none, bands: [], height: ORDERS_HEIGHT, draw: [paint], y, yAxis: { label: "order", labelSize: 18 } }, read);
      section.added.push(ordersPlot);
    } else {
      const look = pictures.axis();
      ordersPlot = new uPlot({
        width: 420, height: ORDERS_HEIGHT, legend: { show: false }, scales: { x: { time: false, range: [0, x[x.length - 1] + width] }, y },
        axes: [{ ...look, label: "km/h", labelSize: 18 }, { ...look, size: pictures.widthFrom(58), label: "order", labelSize: 18 }], series: [{}, ...none], hooks: { draw: [paint], setCursor: [read] },
      }, data, holder);
    }
    ordersPlot.setSize({ width: Math.max(holder.clientWidth, 200), height: ORDERS_HEIGHT });
  });

  // What the user does

  const drawAll = () => { drawSamples(); drawOverview(); if (moment) showMoment({ time: (moment.begin + moment.end) / 2 }); };
  byId("before").addEventListener("click", () => step(-1));
  byId("behind").addEventListener("click", () => step(1));
  byId("number").addEventListener("change", () => { if (byId("number").value !== "") showMoment({ number: Math.max(0, Math.floor(Number(byId("number").value))) }); });
  byId("focus").addEventListener("change", () => showMoment({ time: moment ? (moment.begin + moment.end) / 2 : section.range[0] }));
  for (const id of ["orders-wheel", "orders-axis", "over"]) byId(id).addEventListener("change", () => loadOrders());
  const redraw = () => { if (!section) return; section.draw(); drawAll(); ordersKey = ""; loadOrders(); };
  addEventListener("resize", redraw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  connect();
})();
