// Figures in the units of the reader: metric, or as in the United States. Values and forms are metric everywhere.

export const SYSTEMS = { metric: "m, ha", us: "ft, acres" };
const KEY = "headland-units";
const US = {
  m: [0.3048, "ft"], "m\u00B2": [0.09290304, "ft\u00B2"], ha: [0.40468564224, "ac"], l: [3.785411784, "gal"],
  "km/h": [1.609344, "mph"], "m/s": [0.44704, "mph"], cm: [2.54, "in"], km: [1.609344, "mi"],
};

export const unitsInUse = () => (localStorage.getItem(KEY) === "us" ? "us" : "metric");

/** A metric value and its unit as the reader wants them. */
export function inUnits(value, unit) {
  const found = unitsInUse() === "us" ? US[unit] : undefined;
  return found ? [value / found[0], found[1]] : [value, unit];
}

/** The list of units in the bar changes them. */
export function startUnits(picker) {
  for (const [code, name] of Object.entries(SYSTEMS)) picker.append(new Option(name, code, false, code === unitsInUse()));
  picker.addEventListener("change", () => {
    localStorage.setItem(KEY, picker.value);
    location.reload();
  });
}
