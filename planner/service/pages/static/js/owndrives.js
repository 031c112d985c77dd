// Drives that a tab of this browser asked for and has not kept. Each is noted under a lock of its tab, which the browser
// opens when the tab is gone, however it ended.
const NOTED = "headland-drives", lockOf = (id) => `${NOTED} ${id}`;
const list = () => {
  try { return JSON.parse(localStorage.getItem(NOTED) ?? "[]"); } catch { return []; }
};
const forget = (id) => localStorage.setItem(NOTED, JSON.stringify(list().filter((one) => one !== id)));

/** Note a drive until the function that is returned is called, or the tab is gone. */
export function noteDrive(id) {
  let release = null;
  const held = new Promise((done) => { release = done; });
  navigator.locks?.request(lockOf(id), async () => {
    localStorage.setItem(NOTED, JSON.stringify([...list(), id]));
    await held;
    forget(id);
  });
  return release;
}

/** Call `drop(id)` for the drives whose tab is gone without a word. */
export function dropLostDrives(drop) {
  for (const id of navigator.locks ? new Set(list()) : []) {
    navigator.locks.request(lockOf(id), { ifAvailable: true }, (lock) => {
      if (!lock) return;
      forget(id);
      drop(id);
    });
  }
}
