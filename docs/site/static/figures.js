// Draws the Plotly figures of a page; plotly.js is loaded once for the site, and only by pages that have a figure.
(function () {
  "use strict";
  var here = document.currentScript.src;
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var config = { displayModeBar: false, responsive: false };
  var NARROWEST = 0.6; // of the width that a figure was made for; a narrower page scrolls it

  function draw(figure) {
    var layout = JSON.parse(JSON.stringify(figure.layout)), natural = layout.width || 760;
    layout.width = Math.max(figure.place.clientWidth, Math.round(NARROWEST * natural));
    if (layout.width > 1.2 * natural) layout.width = natural;
    if (window.matchMedia("(pointer: coarse)").matches) layout.dragmode = false; // a finger scrolls the page
    if (dark.matches) {
      layout.paper_bgcolor = layout.plot_bgcolor = "rgba(0,0,0,0)";
      layout.font = Object.assign({}, layout.font, { color: "#ced6dd" });
    }
    Plotly.react(figure.drawn, figure.data, layout, config);
  }

  function start() {
    var figures = Array.prototype.map.call(document.querySelectorAll(".site-figure"), function (place) {
      var figure = JSON.parse(place.querySelector("script").textContent);
      figure.place = place;
      figure.drawn = document.createElement("div");
      place.appendChild(figure.drawn);
      return figure;
    });
    if (!figures.length) return;
    var plotly = document.createElement("script");
    plotly.src = here.replace(/figures\.js.*$/, "plotly.min.js");
    plotly.onload = function () {
      function drawAll() { figures.forEach(draw); }
      var waiting = 0;
      drawAll();
      dark.addEventListener("change", drawAll);
      window.addEventListener("resize", function () {
        clearTimeout(waiting);
        waiting = setTimeout(drawAll, 100);
      });
    };
    document.head.appendChild(plotly);
  }
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start); else start();
})();
