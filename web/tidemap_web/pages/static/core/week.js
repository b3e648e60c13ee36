// A week of hours: what a series is on average at each hour of each weekday, by the local clock.

import { offsetOf } from "./words.js";

export const DAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"];
const HOUR = 3600;
const HOURS = 168;
const MONDAY = 4 * 24 * HOUR; // the epoch was a Thursday

/**
 * The hour of the local week, 0 (Monday 00:00) to 167.
 * @param {number} time
 * @param {string} zone
 */
export function hourOfWeek(time, zone) {
  const hour = Math.floor((time + offsetOf(time, zone) - MONDAY) / HOUR);
  return ((hour % HOURS) + HOURS) % HOURS;
}

/**
 * The mean of the values that there are at each hour of the week, and how many there were.
 * @param {number[]} times
 * @param {(number | null)[]} values
 * @param {string} zone
 * @returns {{ mean: (number | null)[], count: number[] }}
 */
export function weekOf(times, values, zone) {
  const sum = Array.from({ length: HOURS }, () => 0);
  const count = Array.from({ length: HOURS }, () => 0);
  values.forEach((value, i) => {
    if (value === null) return;
    const hour = hourOfWeek(times[i], zone);
    sum[hour] += value;
    count[hour] += 1;
  });
  return { mean: sum.map((total, hour) => (count[hour] ? total / count[hour] : null)), count };
}

/**
 * Monday 00:00 by the local clock, at or before a time.
 * @param {number} time
 * @param {string} zone
 */
export function mondayBefore(time, zone) {
  const local = time + offsetOf(time, zone);
  const monday = Math.floor((local - MONDAY) / (HOURS * HOUR)) * HOURS * HOUR + MONDAY;
  return monday - offsetOf(monday - offsetOf(time, zone), zone);
}
