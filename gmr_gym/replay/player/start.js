// What a page calls.

/** Fill the element with a player of the data; a promise of the player. */
async function start(element, data) {
  try {
    return new Player(element, recording(data, await unpack(data)));
  } catch (error) {
    element.textContent = `The episode cannot be shown: ${error.message}`;
    throw error;
  }
}
