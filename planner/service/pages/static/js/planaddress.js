// A plan request as the address of its form, so that a link opens the form with the same values.
const valueOf = (text) => text === "true" || (text !== "false" && text);

/** The address of the form with the values of a request. */
export function planAddress(request) {
  const given = Object.entries(request).filter(([, value]) => value !== null && value !== undefined);
  return `#/plan?${new URLSearchParams(given.flatMap(([name, value]) => [value].flat().map((one) => [name, String(one)])))}`;
}

/** The request of an address, its values as texts; null where it has none. */
export function requestOfAddress(query) {
  const values = new URLSearchParams(query), request = {};
  for (const name of values.keys()) {
    const all = values.getAll(name).map(valueOf);
    request[name] = all.length > 1 ? all : all[0];
  }
  return Object.keys(request).length ? request : null;
}
