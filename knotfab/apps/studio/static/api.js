/* Talking to the server, and small helpers of the page. */
export const byId = (id) => document.getElementById(id);
export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(key, value);
    else if (value !== undefined && value !== null && value !== false) made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

let last = Promise.resolve(); // calls go one after the other: a press must not overtake a setting

export function call(path, body, kind = "application/json") {
  const answer = last.then(() => ask(path, body, kind));
  last = answer.catch(() => {});
  return answer;
}

async function ask(path, body, kind) {
  let answer;
  try {
    answer = await fetch(path, { method: "POST", body, headers: { "content-type": kind } });
  } catch {
    throw new Error("The studio does not answer: is it still running?");
  }
  const text = await answer.text();
  let found = {};
  try {
    found = JSON.parse(text);
  } catch {
    found = { sentence: text };
  }
  if (!answer.ok) throw new Error(found.sentence || "The studio refused this.");
  return found;
}

export const post = (path, data = {}) => call(path, JSON.stringify(data));

/* Say in `place` why something was refused. */
export async function attempt(place, promise) {
  byId(place).textContent = "";
  try {
    return await promise;
  } catch (error) {
    byId(place).textContent = error.message;
    return null;
  }
}
