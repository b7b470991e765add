// The columns of numbers that the page holds as text.

const TYPES = {
  u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array,
  u4: Uint32Array, i4: Int32Array, f4: Float32Array,
};

/** The columns of the data by name, each decoded when first asked for; null for one that is not there. */
async function unpack(data) {
  if (!window.DecompressionStream) throw new Error("it needs Chrome 80, Firefox 113, Safari 16.4 or newer");
  const packed = Uint8Array.from(atob(data.blob), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const raw = await new Response(stream).arrayBuffer();
  const done = new Map();
  return function column(name) {
    const entry = data.columns[name];
    if (!entry) return null;
    if (entry.same) return column(entry.same);
    if (!done.has(name)) done.set(name, decoded(entry, raw));
    return done.get(name);
  };
}

function decoded({ dtype, shape, at, low = 0, step = 1, nan = false }, raw) {
  const Kind = TYPES[dtype];
  const count = shape.reduce((product, side) => product * side, 1);
  const stored = new Kind(raw.slice(at, at + count * Kind.BYTES_PER_ELEMENT));
  if (dtype === "f4") return stored;
  const integers = step === 1 && Number.isInteger(low) && !nan;
  const values = integers ? new Int32Array(count) : new Float32Array(count);
  const missing = nan ? 256 ** Kind.BYTES_PER_ELEMENT - 1 : NaN;
  for (let i = 0; i < count; i++) values[i] = stored[i] === missing ? NaN : low + step * stored[i];
  return values;
}
