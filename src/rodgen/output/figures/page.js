(function () {
  "use strict";
  var all = function (what, inside) { return Array.prototype.slice.call((inside || document).querySelectorAll(what)); };
  var make = function (name, text, kind) {
    var made = document.createElement(name);
    if (text) made.textContent = text;
    if (kind) made.className = kind;
    if (name === "button") made.type = "button";
    return made;
  };

  // Tables that sort; the rest of a table joins it.
  var value = function (text) { return /million/.test(text) ? 1e6 : parseFloat(text.replace(/less than|[<  ]/g, "")); };
  all("table.sorted").slice(0, 1).forEach(function (table) {
    var body = table.tBodies[0], rest = table.parentNode.nextElementSibling;
    all("thead th", table).forEach(function (head, column, heads) {
      if (!head.textContent) return;
      var button = make("button", head.textContent);
      head.textContent = "";
      head.appendChild(button);
      button.addEventListener("click", function () {
        if (rest && rest.tagName === "DETAILS") {
          all("tbody tr", rest).forEach(function (row) { body.appendChild(row); });
          rest.parentNode.removeChild(rest);
          rest = null;
        }
        var way = head.getAttribute("aria-sort") === "descending" ? 1 : -1;
        var rows = all("tr", body).map(function (row, i) { return { row: row, text: row.children[column].textContent, i: i }; });
        rows.sort(function (a, b) {
          var x = value(a.text), y = value(b.text);
          return way * (isNaN(x) || isNaN(y) ? b.text.localeCompare(a.text) : x - y) || a.i - b.i;
        });
        rows.forEach(function (entry) { body.appendChild(entry.row); });
        heads.forEach(function (other) { other.removeAttribute("aria-sort"); });
        head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      });
    });
  });

  // Text to take along.
  all(".copy").forEach(function (part) {
    var button = make("button", "Copy", "copy-button"), text = part.querySelector("pre");
    button.setAttribute("aria-label", part.getAttribute("data-what") || "Copy");
    button.addEventListener("click", function () {
      var done = function () { button.textContent = "Copied"; setTimeout(function () { button.textContent = "Copy"; }, 1500); };
      var old = function () {
        var range = document.createRange(), chosen = window.getSelection();
        range.selectNodeContents(text);
        chosen.removeAllRanges();
        chosen.addRange(range);
        if (document.execCommand("copy")) done();
      };
      if (navigator.clipboard && window.isSecureContext) navigator.clipboard.writeText(text.textContent).then(done, old);
      else old();
    });
    part.appendChild(button);
  });

  window.addEventListener("beforeprint", function () { all("details").forEach(function (part) { part.open = true; }); });
})();
