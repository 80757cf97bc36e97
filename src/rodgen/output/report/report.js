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
  all("table[data-sort]").forEach(function (table) {
    var body = table.tBodies[0], rest = document.getElementById(table.getAttribute("data-sort"));
    all("thead th[data-key]", table).forEach(function (head, _, heads) {
      var button = make("button", head.textContent);
      head.textContent = "";
      head.appendChild(button);
      button.addEventListener("click", function () {
        if (rest) {
          all("tbody tr", rest).forEach(function (row) { body.appendChild(row); });
          rest.parentNode.removeChild(rest);
          rest = null;
        }
        var up = head.getAttribute("aria-sort") ? head.getAttribute("aria-sort") === "descending" : head.getAttribute("data-key") === "up";
        var column = Array.prototype.indexOf.call(head.parentNode.children, head);
        var value = function (row) { return row.children[column].getAttribute("data-value"); };
        var rows = all("tr", body).map(function (row, i) { return { row: row, value: value(row), i: i }; });
        rows.sort(function (a, b) {
          var x = Number(a.value), y = Number(b.value), way = up ? 1 : -1;
          var c = isNaN(x) || isNaN(y) ? a.value.localeCompare(b.value) : x - y;
          return way * c || a.i - b.i;
        });
        rows.forEach(function (entry) { body.appendChild(entry.row); });
        heads.forEach(function (other) { other.removeAttribute("aria-sort"); });
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
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

  // A scale's radius makes micrometres of an eccentricity.
  all("[data-per-mm]").forEach(function (part) {
    var label = make("label", "Radius of the scale: "), input = make("input"), out = make("output");
    input.type = "number";
    input.min = "0";
    input.step = "any";
    input.value = part.getAttribute("data-radius") || "50";
    var tell = function () {
      var off = Number(part.getAttribute("data-per-mm")) * Number(input.value);
      out.textContent = isFinite(off) && input.value !== "" ? " mm, " + Number(off.toPrecision(3)) + " µm off the axis" : " mm";
    };
    input.addEventListener("input", tell);
    label.appendChild(input);
    label.appendChild(out);
    part.appendChild(label);
    tell();
  });

  window.addEventListener("beforeprint", function () { all("details").forEach(function (part) { part.open = true; }); });
})();
