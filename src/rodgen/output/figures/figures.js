(function () {
  "use strict";
  var given = JSON.parse(document.getElementById("figures").textContent);
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var touch = window.matchMedia("(pointer: coarse)").matches;
  var config = { displayModeBar: false, responsive: false, typesetMath: false, doubleClick: "reset+autosize" };
  var PANEL_TITLE = 26, NATURAL = 660, PRINTED = 680;

  // A copy of a figure as the page shows it: the page writes title and note itself.
  function prepared(number, asDark) {
    var text = JSON.stringify(given.figures[number]);
    if (asDark) Object.keys(given.dark).forEach(function (light) { text = text.split(light).join(given.dark[light]); });
    var figure = JSON.parse(text), layout = figure.layout, block = layout.meta.block;
    layout.height -= block;
    layout.margin.t -= block;
    delete layout.title;
    delete layout.width;
    if (!layout.legend) layout.legend = {};
    layout.legend.y = 1;
    if (touch) layout.dragmode = false;  // a finger scrolls the page
    return figure;
  }

  // Panels whose units are as long both ways become as low as they become narrow.
  function shrink(layout, width) {
    var meta = layout.meta, margin = layout.margin, share = Math.min(1, (width - margin.l - margin.r) / NATURAL);
    if (!meta.heights || share === 1) return;
    var heights = meta.heights.map(function (high, i) { return meta.equal[i] ? Math.round(high * share) : high; });
    var inner = heights.concat(meta.gaps).reduce(function (sum, high) { return sum + high; }, 0), top = inner;
    heights.forEach(function (high, i) {
      layout["yaxis" + (i ? i + 1 : "")].domain = [(top - high) / inner, top / inner];
      top -= high + meta.gaps[i];
    });
    layout.height = margin.t + margin.b + inner;
  }

  // First with fixed margins, to find how high the legend becomes; then with room for all of its lines.
  function draw(plot, width, asDark) {
    var figure = prepared(plot.number, asDark), layout = figure.layout, margin = layout.margin;
    plot.width = width;
    layout.width = Math.max(width, layout.meta.width);
    shrink(layout, layout.width);
    margin.autoexpand = false;
    Plotly.react(plot.drawn, figure.data, layout, config);
    // Margins that grow with their numbers make the legend narrower, and it may need another line.
    var more = 0;
    for (var round = 0; round < 3; round++) {
      var legend = plot.drawn.querySelector(".legend");
      var needed = legend ? Math.ceil(legend.getBBox().height) + PANEL_TITLE + 4 - margin.t : 0;
      if (round && needed <= more) break;
      more = Math.max(needed, more);
      var settled = Object.assign({}, layout, { height: layout.height + more });
      settled.margin = Object.assign({}, margin, { t: margin.t + more, autoexpand: true });
      Plotly.react(plot.drawn, figure.data, settled, config);
    }
  }

  var plots = Array.prototype.map.call(document.querySelectorAll(".plot[data-figure]"), function (place) {
    var plot = { place: place, number: Number(place.getAttribute("data-figure")), drawn: document.createElement("div") };
    place.appendChild(plot.drawn);
    var row = document.createElement("div");
    row.className = "save";
    ["png", "svg"].forEach(function (kind) {
      var button = document.createElement("button");
      button.type = "button";
      button.textContent = kind.toUpperCase();
      button.setAttribute("aria-label", "Save this figure as " + kind.toUpperCase());
      button.addEventListener("click", function () {
        var figure = given.figures[plot.number];
        Plotly.downloadImage(JSON.parse(JSON.stringify(figure)), {
          format: kind, filename: figure.layout.meta.name, width: figure.layout.width, height: figure.layout.height, scale: kind === "png" ? 2 : 1
        });
      });
      row.appendChild(button);
    });
    place.parentNode.insertBefore(row, place.nextSibling);
    return plot;
  });
  // What is folded is drawn when it is unfolded.
  function drawSeen(plot) {
    if (!plot.place.closest("details:not([open])")) draw(plot, plot.place.clientWidth, dark.matches);
  }
  function drawNew(plot) { if (plot.place.clientWidth !== plot.width) drawSeen(plot); }
  function drawAll() { plots.forEach(drawSeen); }
  drawAll();
  document.addEventListener("toggle", function () { plots.forEach(drawNew); }, true);

  var waiting = 0;
  window.addEventListener("resize", function () {
    clearTimeout(waiting);
    waiting = setTimeout(function () {
      plots.forEach(drawNew);
    }, 100);
  });
  dark.addEventListener("change", drawAll);
  window.addEventListener("beforeprint", function () {
    plots.forEach(function (plot) {
      var folded = plot.place.closest("details");
      if (folded) folded.open = true;
      draw(plot, Math.min(plot.place.clientWidth, PRINTED), false);
    });
  });
  window.addEventListener("afterprint", drawAll);
})();
