// What a form asks, answered while it changes: at once by an estimate, then by one that is laid out, then by a drive.
import { answerBox } from "./answerbox.js";
import { speak } from "./dom.js";
import { t, translate } from "./language.js";
import { get, part, post, remove } from "./api.js";
import { dropLostDrives, noteDrive } from "./owndrives.js";

const REST_MS = 3000, LOOK_MS = 700, BUSY_MS = 2000, LONGEST_LOOK_MS = 30_000, SPOKEN_MS = 1000;
const INVALID = 422, TOO_MANY = 429, SERVER_FAULT = 500;
const WILL = { true: "Driven in full once you leave the values as they are.", false: "Change a value, and this follows." };
const SCALED = 0, LAID_OUT = 1, DRIVEN = 2, LEVELS = 3;

/** The box of answers. `change(request)` says what is asked now; what is asked again unchanged is not asked twice.

`laidOut(answer, isLatest)` takes every estimate that was laid out, with its lines, and whether it answers the last change. */
export function liveAnswer(laidOut = () => {}) {
  const box = answerBox();
  let changes = 0, shown = -1, latest = "", ground = null, resting = 0, speaking = 0, drive = null, closed = false;

  // An answer takes the place of those to earlier changes, and of less exact ones to its own.
  const show = (answer, change, level, words = "") => {
    const rank = LEVELS * change + level;
    if (closed || rank < shown) return;
    shown = rank;
    if (level === LAID_OUT) laidOut(answer, change === changes);
    box.show(answer, { isDriven: level === DRIVEN, isLatest: change === changes, words });
    clearTimeout(speaking);
    speaking = setTimeout(() => speak(box.words()), SPOKEN_MS);
  };
  // What cannot be planned leaves no figures. What fails otherwise leaves those that are there, and is asked again where the
  // service says that it is too much for now.
  const refuse = (error, asked, again) => {
    if (closed || asked.change !== changes) return;
    if (error.status !== INVALID && shown >= LEVELS * asked.change) box.tell(error.message);
    else box.refuse(error.message);
    shown = Math.max(shown, LEVELS * asked.change);
    if (error.status === TOO_MANY) setTimeout(() => { if (!closed && asked.change === changes) again(asked); }, BUSY_MS);
  };

  // One request at a time, always the latest.
  const lane = (path, answered) => {
    let busy = false, waiting = null;
    const ask = async (asked) => {
      waiting = asked;
      if (busy) return;
      for (busy = true; waiting && !closed; ) {
        const now = waiting;
        waiting = null;
        try { answered(await post(path, now.values), now); } catch (error) { refuse(error, now, ask); }
      }
      busy = false;
    };
    return ask;
  };
  const settle = (asked) => {
    if (asked.change !== changes) return; // the answer to an earlier change starts nothing, and stops nothing
    clearTimeout(resting);
    if (asked.isDriven) resting = setTimeout(() => startDrive(asked), REST_MS);
  };
  const layOut = lane("estimates", (answer, asked) => {
    show({ ...answer, start: asked.values.start }, asked.change, LAID_OUT, WILL[asked.isDriven]);
    settle(asked);
  });
  const answerAtOnce = lane("estimates?at_once=true", (answer, asked) => {
    show({ ...answer, start: asked.values.start }, asked.change, answer.is_scaled ? SCALED : LAID_OUT, WILL[asked.isDriven]);
    if (!answer.is_scaled) settle(asked);
    else if (asked.change === changes) layOut(asked);
  });
  const startDrive = async (asked) => {
    const mine = drive = { key: latest, id: null, isKept: false, isOver: false, isFollowed: true, release: () => {} };
    box.tell("Driving it in full");
    try {
      mine.id = (await post("plans", asked.values)).id;
      mine.release = noteDrive(mine.id);
      if (!mine.isOver) await follow(mine, asked);
    } catch (error) { if (!mine.isOver) box.tell(error.message); }
    mine.isFollowed = false;
    if (mine.isOver) drop(mine);
  };
  const follow = async (mine, asked) => {
    const path = `plans/${part(mine.id)}`;
    let answer = null, pause = LOOK_MS, [counted, total] = [0, 0]; // the furthest: a job that begins anew counts from 0
    while (!answer) {
      try {
        const job = await get(path);
        pause = LOOK_MS;
        if (mine.isOver) return;
        if (["failed", "cancelled"].includes(job.status)) return box.tell(job.error || "It was cancelled.");
        const { done = null, all = null } = job.progress ?? {};
        if (all && done * total >= counted * all) [counted, total] = [done, all];
        box.tell(total ? t`Driving it in full: ${counted} of ${total}` : translate("Driving it in full"));
        if (job.status === "done") answer = await get(`${path}/results/result.json`);
      } catch (error) {
        if (mine.isOver) return;
        if (error.status && error.status !== TOO_MANY && error.status < SERVER_FAULT) throw error;
        pause = Math.min(2 * pause, LONGEST_LOOK_MS);
        box.tell(t`${translate(error.message)} It is asked again.`);
      }
      if (!answer) await new Promise((looked) => setTimeout(looked, pause));
    }
    if (!mine.isOver) show(drivenAnswer(answer, asked.values, `#/plan/${part(mine.id)}`), asked.change, DRIVEN, answer.plans.some((plan) => plan.p50_s) ? "Driven in full, with late starts, stops and breakdowns." : "Driven in full.");
  };
  const removeDrive = (id) => remove(`plans/${part(id)}`).catch(() => {});
  const drop = (one) => {
    one.release();
    if (one.id && !one.isKept) removeDrive(one.id);
  };
  const keep = (one) => {
    one.release();
    one.isKept = true;
  };
  // What is being asked for is dropped after that, unless nobody is left to do so.
  const end = (isLeft = false) => {
    clearTimeout(resting);
    if (drive) { drive.isOver = true; if (isLeft || !drive.isFollowed) drop(drive); }
    drive = null;
  };
  box.kept = () => { if (drive) keep(drive); };
  dropLostDrives(removeDrive);
  window.addEventListener("pagehide", end);

  return {
    node: box.node,
    /** `isDriven`: whether a drive is to follow once it rests. */
    change(values, isDriven = true) {
      const key = JSON.stringify(values);
      if (closed || key === latest) return false;
      end();
      latest = key;
      changes += 1;
      if (values.field !== ground) { // figures of another field are wrong, not just old
        box.empty();
        shown = LEVELS * changes;
      }
      ground = values.field;
      box.wait();
      answerAtOnce({ values, change: changes, isDriven });
      return true;
    },
    /** The job that drives a request already, which is then kept; null without one. */
    takeDrive(values) {
      if (!drive?.id || drive.key !== JSON.stringify(values)) return null;
      keep(drive);
      return drive.id;
    },
    close() {
      end();
      closed = true;
      clearTimeout(speaking);
      window.removeEventListener("pagehide", end);
    },
  };
}

// A driven plan for each number of tractors, the best of its strategies, in the form of an estimate.
function drivenAnswer({ plans, best, scenario, currency, shortfalls = [], pull }, values, address) {
  const byRank = plans.filter((plan) => plan.feasible).sort((one, other) => one.rank - other.rank), counts = [...new Set(plans.map((plan) => plan.tractors))].sort((one, other) => one - other);
  const rows = counts.map((count) => byRank.find((plan) => plan.tractors === count) ?? plans.find((plan) => plan.tractors === count));
  return { plans: rows, recommended: best?.tractors ?? null, start: scenario?.start ?? values.start, currency, address, caution: shortfalls.map((one) => one.sentence).join(" ") || pull?.question };
}
