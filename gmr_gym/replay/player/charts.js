// What the charts below the panels show.

/** The charts of an episode, as nodes that draw themselves. */
function chartsOf(episode, scrub) {
  const { trackers, many } = episode;
  const lines = (many ? manyCharts(trackers) : oneCharts(trackers)).filter(({ series }) => series.length);
  const bands = trackers.filter((tracker) => tracker.mode_p);
  return [
    ...lines.map((chart) => new LineStrip(chart, episode, scrub)),
    ...bands.map((tracker) => new BandStrip(tracker, episode, scrub)),
  ];
}

function oneCharts(trackers) {
  const numbers = seriesOf(trackers, "count");
  for (const one of numbers) one.before = numbersBefore(one.tracker, one.values.length);
  return [
    { title: "Error", unit: " m", series: seriesOf(trackers, "error") },
    { title: "Hypotheses", unit: "", series: numbers },
  ];
}

function manyCharts(trackers) {
  const { present } = trackers[0];
  const truth = present ? [{ name: "true number", values: present, colour: "truth", lost: -1 }] : [];
  return [
    { title: "GOSPA", unit: " m", series: seriesOf(trackers, "gospa") },
    { title: "Expected number of targets", unit: "", series: [...truth, ...seriesOf(trackers, "expected")] },
  ];
}

const seriesOf = (trackers, key) =>
  trackers
    .map((tracker, i) => ({
      name: trackers.length > 1 ? tracker.name : "",
      values: tracker[key],
      colour: `tracker${i}`,
      lost: tracker.lost,
      tracker,
    }))
    .filter(({ values }) => values);

/** Number of hypotheses before the reduction of every scan; null where that is not known. */
const numbersBefore = (tracker, scans) =>
  tracker.full && Float32Array.from({ length: scans }, (_, t) => counts(tracker, t).all);

/** Ratio of the greatest value of some series to one that a quarter of them do not reach. */
function spread(series) {
  const values = series.flatMap(({ values }) => [...values]).filter((value) => value > 0);
  values.sort((a, b) => a - b);
  return values.length ? values[values.length - 1] / values[values.length >> 2] : 1;
}
