// Times and periods in words, in the time zone of a location.

const formats = new Map();

function format(zone, key, options) {
  const name = zone + key;
  if (!formats.has(name)) formats.set(name, new Intl.DateTimeFormat("en-GB", { timeZone: zone, ...options }));
  return formats.get(name);
}

function parts(time, zone) {
  const options = {
    weekday: "short", day: "numeric", month: "short", year: "numeric",
    hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23", timeZoneName: "short",
  };
  const found = {};
  for (const part of format(zone, "all", options).formatToParts(time * 1000)) found[part.type] = part.value;
  return found;
}

export function dateText(time, zone) {
  const p = parts(time, zone);
  return `${p.weekday} ${p.day} ${p.month} ${p.year}`;
}

export function clockText(time, zone, seconds = true) {
  const p = parts(time, zone);
  return seconds ? `${p.hour}:${p.minute}:${p.second}` : `${p.hour}:${p.minute}`;
}

export function zoneText(time, zone) {
  const short = parts(time, zone).timeZoneName;
  return short === zone ? zone : `${zone} (${short})`;
}

export function timeText(time, zone) {
  return `${dateText(time, zone)}, ${clockText(time, zone)}`;
}

export function dayText(time, zone) {
  const p = parts(time, zone);
  return `${p.weekday} ${p.day} ${p.month}`;
}

/** Seconds that local time is ahead of UTC at a moment. */
export function offsetOf(time, zone) {
  const options = {
    year: "numeric", month: "numeric", day: "numeric", hour: "numeric", minute: "numeric", second: "numeric",
    hourCycle: "h23",
  };
  const p = {};
  for (const part of format(zone, "offset", options).formatToParts(time * 1000)) p[part.type] = Number(part.value);
  const local = Date.UTC(p.year, p.month - 1, p.day, p.hour, p.minute, p.second) / 1000;
  return local - Math.floor(time);
}

const STEPS = [[100, 1, "s"], [3600, 60, "min"], [47 * 3600, 3600, "h"], [Infinity, 86400, "d"]];

export function durationText(seconds) {
  const [, size, unit] = STEPS.find(([limit]) => seconds < limit);
  return `${Number((seconds / size).toPrecision(3))} ${unit}`;
}
