// Columns of numbers out of base64; see app/_packing.py.
const UNKNOWN = 65535;

export function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

export function int32(text) {
  return new Int32Array(bytesOf(text).buffer);
}

export function floats(packed) {
  const codes = new Uint16Array(bytesOf(packed.codes).buffer);
  const values = new Float32Array(codes.length);
  for (let i = 0; i < codes.length; i++) {
    values[i] = codes[i] === UNKNOWN ? NaN : packed.offset + packed.scale * codes[i];
  }
  return values;
}
