// Bytes that stand in the page as base64 of what gzip makes of them.

export async function bytes(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export async function doubles(text) {
  return new Float64Array((await bytes(text)).buffer);
}

export async function floats(text) {
  return new Float32Array((await bytes(text)).buffer);
}
