"""What the page of a folder runs besides its plots: sorting, searching, and showing whose a dot is."""

SCRIPT = """
const table = document.getElementById("episodes");
if (table) {
  const rows = [...table.tBodies[0].rows];
  const key = cell => cell.dataset.v !== undefined ? (cell.dataset.v === "" ? NaN : Number(cell.dataset.v))
    : cell.textContent;
  const compare = (a, b) => typeof a === "number" ? a - b : a.localeCompare(b, "en", {numeric: true});
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const sense = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      [...table.tHead.rows[0].cells].forEach(each => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", sense > 0 ? "ascending" : "descending");
      const keyed = rows.map(row => [key(row.cells[column]), row]);
      const absent = keyed.filter(each => Number.isNaN(each[0]));
      const known = keyed.filter(each => !Number.isNaN(each[0])).sort((a, b) => sense * compare(a[0], b[0]));
      table.tBodies[0].append(...known.concat(absent).map(each => each[1]));
    });
  });
  const search = document.getElementById("search"), only = document.getElementById("only-defects");
  const found = document.getElementById("found");
  const show = () => {
    const words = search.value.toLowerCase().split(/\\s+/).filter(Boolean);
    let count = 0;
    rows.forEach(row => {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every(word => text.includes(word)) ||
        (only.checked && !row.classList.contains("with-defect"));
      count += !row.hidden;
    });
    found.textContent = `${count} of ${rows.length} episodes`;
  };
  search.addEventListener("input", show);
  only.addEventListener("change", show);
  show();
}
const tip = document.createElement("div");
tip.className = "tip";
tip.hidden = true;
document.body.append(tip);
const dots = new Map();
document.querySelectorAll("[data-e]").forEach(dot => {
  if (!dots.has(dot.dataset.e)) dots.set(dot.dataset.e, []);
  dots.get(dot.dataset.e).push(dot);
});
let lit = null;
const light = dot => {
  if (lit) dots.get(lit).forEach(each => each.classList.remove("lit"));
  lit = dot ? dot.dataset.e : null;
  tip.hidden = !dot;
  if (!dot) return;
  dots.get(lit).forEach(each => { each.classList.add("lit"); each.parentNode.append(each); });
  tip.textContent = dot.getAttribute("aria-label");
  const place = dot.getBoundingClientRect();
  tip.style.top = `${place.top - 34}px`;
  tip.style.left = `${Math.max(4, Math.min(place.left - 20, innerWidth - tip.offsetWidth - 8))}px`;
};
document.querySelectorAll(".strips").forEach(strips => {
  strips.addEventListener("pointerover", event => {
    const dot = event.target.closest("[data-e]");
    if (dot ? dot.dataset.e !== lit || tip.textContent !== dot.getAttribute("aria-label") : lit) light(dot);
  });
  strips.addEventListener("pointerleave", () => light(null));
});
"""
