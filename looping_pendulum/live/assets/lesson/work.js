/** What somebody predicted, measured and was told in a step of the lesson, as it is kept when the page is left. */

import { LANGUAGES } from "../texts.js";

/** @import { Judgement, Step } from "./steps.js" */
/**
 * @typedef {{prediction: string, counted: string, measured: string, judgement: Judgement | null}} Work
 *   `prediction`: what is chosen or typed; `counted`: what was when the button was pressed; "": nothing yet
 */

const LONGEST = 40;

/** Whether words are an answer to a step: one of its options, or a number above 0. @param {Step} step @param {string} answer */
export const isAnswer = ({ options }, answer) => (options.length ? options.includes(answer) : answer !== "" && Number(answer) > 0);

/** The work in a step, of whatever was kept: what cannot be of this step is left out. @param {Step} step @param {any} [kept]
 * @returns {Work} */
export function workOf(step, kept) {
  const answer = (/** @type {unknown} */ found) => (typeof found === "string" && isAnswer(step, found) ? found : "");
  const { prediction, counted, measured, judgement } = kept ?? {};
  return {
    prediction: typeof prediction === "string" ? prediction.slice(0, LONGEST) : "",
    counted: answer(counted),
    measured: answer(measured),
    judgement: answer(counted) ? judgementOf(step, judgement) : null,
  };
}

/** @param {Step} step @param {any} kept @returns {Judgement | null} */
function judgementOf(step, kept) {
  const { found, right, values, ratio } = kept ?? {};
  const needed = LANGUAGES.en[`lesson.${step.name}.why`].matchAll(/\{(\w+)\}/g);
  const isWhole = [...needed].every(([, name]) => Number.isFinite(values?.[name]));
  if (!isWhole || typeof right !== "boolean" || !isAnswer(step, String(found))) return null;
  return { found, right, values: values ?? {}, ...(Number.isFinite(ratio) && { ratio }) };
}
