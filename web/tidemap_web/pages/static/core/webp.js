// Animated WebP from still ones: https://developers.google.com/speed/webp/docs/riff_container

/** What of a still picture goes into a frame: its transparency and itself. */
const PICTURE = new Set(["ALPH", "VP8 ", "VP8L"]);
const ANIMATED = 0x02;
const TRANSPARENT = 0x10;
const HEADER = 12;

/**
 * One file of several pictures of the same size, each shown for so long; it goes round for ever.
 * @param {Uint8Array<ArrayBuffer>[]} pictures files of WebP
 * @param {{ width: number, height: number, duration_ms: number, last_ms: number }} how the last picture may stay longer
 * @returns {Blob}
 * @throws {RangeError} where a picture is no WebP
 */
export function animatedWebp(pictures, { width, height, duration_ms, last_ms }) {
  const size = [...least3(width - 1), ...least3(height - 1)];
  const parts = [chunk("VP8X", [new Uint8Array([ANIMATED | TRANSPARENT, 0, 0, 0, ...size])]), chunk("ANIM", [new Uint8Array(6)])];
  pictures.forEach((picture, i) => {
    const duration = i === pictures.length - 1 ? last_ms : duration_ms;
    const head = new Uint8Array([...least3(0), ...least3(0), ...size, ...least3(duration), 0]);
    parts.push(chunk("ANMF", [head, ...pictureOf(picture)]));
  });
  const body = [text("WEBP"), ...parts.flat()];
  return new Blob([text("RIFF"), least4(lengthOf(body)), ...body], { type: "image/webp" });
}

/**
 * The chunks of a file that are its picture, with their heads and padding.
 * @param {Uint8Array<ArrayBuffer>} file
 * @returns {Uint8Array<ArrayBuffer>[]}
 */
function pictureOf(file) {
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength);
  const name = (/** @type {number} */ at) => String.fromCharCode(...file.subarray(at, at + 4));
  if (file.length < HEADER || name(0) !== "RIFF" || name(8) !== "WEBP") throw new RangeError("this is no WebP");
  const found = [];
  for (let at = HEADER; at + 8 <= file.length; ) {
    const whole = 8 + padded(view.getUint32(at + 4, true));
    if (PICTURE.has(name(at))) found.push(file.subarray(at, at + whole));
    at += whole;
  }
  if (!found.length) throw new RangeError("this WebP has no picture");
  return found;
}

/**
 * @param {string} name
 * @param {Uint8Array<ArrayBuffer>[]} parts
 * @returns {Uint8Array<ArrayBuffer>[]}
 */
function chunk(name, parts) {
  const length = lengthOf(parts);
  return [text(name), least4(length), ...parts, new Uint8Array(padded(length) - length)];
}

/** @param {Uint8Array[]} parts */
const lengthOf = (parts) => parts.reduce((sum, part) => sum + part.length, 0);

/** @param {number} length */
const padded = (length) => length + (length % 2);

/** @param {string} name */
const text = (name) => new Uint8Array([...name].map((letter) => letter.charCodeAt(0)));

/**
 * A number in three bytes, the least first.
 * @param {number} value
 */
const least3 = (value) => [value & 255, (value >> 8) & 255, (value >> 16) & 255];

/** @param {number} value */
function least4(value) {
  const bytes = new Uint8Array(4);
  new DataView(bytes.buffer).setUint32(0, value, true);
  return bytes;
}
