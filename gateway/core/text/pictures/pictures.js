"use strict";
// Pictures of quantities over time, one wheel a colour: what the live page and the pages of drives draw alike.
const pictures = (() => {
  const COLOURS = 8, DASHES = [[], [9, 4], [3, 3], [12, 3, 3, 3]];
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colourOf = (i) => css(`--w${i % COLOURS}`);
  const faint = (colour) => `${colour}33`;
  const axis = () => ({ stroke: css("--ink"), grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line") } });
  const dashOf = (i) => DASHES[i % DASHES.length];
  // A wheel has four series: valid, provisional, and the limits of one standard error about both.
  const seriesOf = (i, { isPrinted = false } = {}) => {
    const stroke = colourOf(i), none = { stroke: "transparent", points: { show: false } };
    return [
      { stroke, width: 2, dash: isPrinted ? dashOf(i) : [], points: { show: false } },
      { stroke, width: isPrinted ? 1 : 2, dash: isPrinted ? [1, 3] : [5, 4], points: { show: false } },
      none,
      none,
    ];
  };
  const bandsOf = (wheels) => wheels.map((i, at) => ({ series: [4 * at + 3, 4 * at + 4], fill: faint(colourOf(i)) }));
  // The four columns of a wheel at one time; undefined is drawn through, null is a gap.
  const cellsOf = (value, error, isProvisional) => [
    value !== null && !isProvisional ? value : null,
    value !== null && isProvisional ? value : null,
    value !== null && error !== null ? value + error : null,
    value !== null && error !== null ? value - error : null,
  ];
  const digitsOf = (error) => Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(error))));
  const written = (value, error, unit, isProvisional) =>
    `${error ? value.toFixed(digitsOf(error)) : Number(value.toPrecision(4))}${error ? ` ± ${error.toFixed(digitsOf(error))}` : ""}${unit ? ` ${unit}` : ""}${isProvisional ? " ~" : ""}`;
  // The piece of line that stands beside the name of a wheel.
  const key = (i, dash) => {
    const box = document.createElement("span");
    // Nothing in it comes from outside: an index, and a colour of the style sheet.
    box.innerHTML = `<svg class="key" aria-hidden="true" viewBox="0 0 26 6"><line x1="0" x2="26" y1="3" y2="3" stroke="${colourOf(i)}" stroke-width="3" stroke-dasharray="${dash.join(" ")}"/></svg>`;
    return box.firstChild;
  };
  return { axis, bandsOf, cellsOf, colourOf, css, dashOf, faint, key, seriesOf, written };
})();
