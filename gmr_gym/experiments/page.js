// Columns of the tables of figures sort: by a click upwards, by another one downwards. What is not defined stands last.
for (const table of document.querySelectorAll("table.figures")) {
  const body = table.tBodies[0];
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    heading.querySelector("button")?.addEventListener("click", () => {
      const direction = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      headings.forEach((other) => other.removeAttribute("aria-sort"));
      heading.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
      const value = (row) => (row.cells[column].dataset.value === "" ? NaN : Number(row.cells[column].dataset.value));
      const order = (a, b) => {
        const [x, y] = [value(a), value(b)];
        if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y);
        return direction * (x - y);
      };
      body.append(...[...body.rows].sort(order));
    });
  });
}
