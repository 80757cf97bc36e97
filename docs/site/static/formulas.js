// A formula in a line of text that is wider than the text scrolls by itself, as a displayed one does.
(function () {
  "use strict";
  function fit() {
    document.querySelectorAll("span.math > mjx-container").forEach(function (formula) {
      formula.classList.remove("wide");
      var block = formula.closest("p, li, td, dd, div");
      formula.classList.toggle("wide", formula.getBoundingClientRect().width > block.clientWidth);
    });
  }
  window.addEventListener("load", function () {
    if (!window.MathJax || !window.MathJax.startup) return;
    window.MathJax.startup.promise.then(function () {
      var waiting = 0;
      fit();
      window.addEventListener("resize", function () {
        clearTimeout(waiting);
        waiting = setTimeout(fit, 100);
      });
    });
  });
})();
