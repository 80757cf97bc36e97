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

  // What a point is, when it is pointed at or stepped to; the same row in every panel at once.
  var tips = JSON.parse(document.getElementById("tips").textContent);
  var box = document.body.appendChild(make("div", "", "tip"));
  var told = document.body.appendChild(make("div", "", "told"));
  box.setAttribute("aria-hidden", "true");
  told.setAttribute("aria-live", "polite");
  told.style.cssText = "position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%)";
  var hot = [];
  function hide() {
    hot.forEach(function (mark) { mark.classList.remove("hot"); });
    hot = [];
    box.style.visibility = "hidden";
  }
  function show(svg, mark, aloud) {
    var of = svg.getAttribute("data-tips"), number = mark.getAttribute("data-tip"), text = tips[of][number];
    hide();
    all('svg[data-tips="' + of + '"] [data-tip="' + number + '"]').forEach(function (same) {
      same.classList.add("hot");
      hot.push(same);
    });
    box.textContent = text;
    if (aloud) told.textContent = text;
    var at = mark.getBoundingClientRect(), size = box.getBoundingClientRect();
    var x = Math.min(Math.max(at.left + at.width / 2 + 12, 4), Math.max(window.innerWidth - size.width - 8, 4));
    var y = at.top - size.height - 8;
    box.style.left = x + "px";
    box.style.top = (y < 4 ? at.bottom + 10 : y) + "px";
    box.style.visibility = "visible";
  }
  all("svg[data-tips]").forEach(function (svg) {
    var marks = null, current = -1;
    function known() {
      if (!marks) {
        marks = all("[data-tip]", svg).map(function (mark) {
          var b = mark.getBBox();
          return { mark: mark, x: b.x + b.width / 2, y: b.y + b.height / 2 };
        });
      }
      return marks;
    }
    function nearest(event) {
      var matrix = svg.getScreenCTM();
      if (!matrix) return -1;
      var x = (event.clientX - matrix.e) / matrix.a, y = (event.clientY - matrix.f) / matrix.d;
      var best = -1, least = Math.pow(16 / matrix.a, 2);
      known().forEach(function (m, i) {
        var d = Math.pow(m.x - x, 2) + Math.pow(m.y - y, 2);
        if (d < least) { least = d; best = i; }
      });
      return best;
    }
    function point(event) {
      var found = nearest(event);
      if (found < 0) { hide(); current = -1; }
      else if (found !== current) { current = found; show(svg, marks[found].mark, false); }
    }
    svg.addEventListener("pointermove", point);
    svg.addEventListener("pointerdown", point);
    svg.addEventListener("pointerleave", function () { current = -1; hide(); });
    svg.addEventListener("blur", function () { current = -1; hide(); });
    svg.addEventListener("keydown", function (event) {
      var by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (event.key === "Escape") { current = -1; hide(); return; }
      if (!by || !known().length) return;
      event.preventDefault();
      current = (current + by + marks.length) % marks.length;
      show(svg, marks[current].mark, true);
    });
  });
  window.addEventListener("scroll", hide, { passive: true });

  // Before, after, or both.
  all("figure[data-two]").forEach(function (figure) {
    var row = make("div", "", "switch");
    row.setAttribute("role", "group");
    row.setAttribute("aria-label", "What is shown");
    [["both", "Both"], ["before", "Before"], ["after", "After"]].forEach(function (choice) {
      var button = row.appendChild(make("button", choice[1]));
      button.setAttribute("aria-pressed", String(choice[0] === "both"));
      button.addEventListener("click", function () {
        figure.setAttribute("data-show", choice[0]);
        all("button", row).forEach(function (other) { other.setAttribute("aria-pressed", String(other === button)); });
        hide();
      });
    });
    figure.insertBefore(row, figure.querySelector(".views"));
  });

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
