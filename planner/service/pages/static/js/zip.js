// Files out of a zip archive (stored or deflated), by its directory at the end: PKWARE's APPNOTE, 4.3.

const END = 0x06054b50, ENTRY = 0x02014b50, END_BYTES = 22, LONGEST_COMMENT = 65535, DEFLATED = 8;

/** Names and texts of the files of a Blob that ends in `ending`; throws an Error with a sentence if it is not a zip. */
export async function textsOf(blob, ending = ".csv") {
  const buffer = await blob.arrayBuffer(), view = new DataView(buffer), found = [];
  let at = endOf(view);
  for (let left = view.getUint16(at + 10, true), entry = view.getUint32(at + 16, true); left > 0; left--) {
    if (view.getUint32(entry, true) !== ENTRY) throw new Error("The recording is damaged; save it again.");
    const [method, bytes] = [view.getUint16(entry + 10, true), view.getUint32(entry + 20, true)];
    const [name, extra, comment] = [28, 30, 32].map((k) => view.getUint16(entry + k, true)), local = view.getUint32(entry + 42, true);
    const title = new TextDecoder().decode(new Uint8Array(buffer, entry + 46, name));
    if (title.endsWith(ending)) {
      const start = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
      found.push({ name: title, text: await unpacked(new Uint8Array(buffer, start, bytes), method) });
    }
    entry += 46 + name + extra + comment;
  }
  return found;
}

function endOf(view) {
  for (let at = view.byteLength - END_BYTES; at >= Math.max(0, view.byteLength - END_BYTES - LONGEST_COMMENT); at--) {
    if (view.getUint32(at, true) === END) return at;
  }
  throw new Error("The file is not a zip archive; choose a recording saved from this page.");
}

async function unpacked(bytes, method) {
  if (method !== DEFLATED) return new TextDecoder().decode(bytes);
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"))).text();
}
