// Calls of operations of the console's server.

// Each ends after at most this time.
const CALL_MS = 120000;

// Call an operation of the server. Returns its answer; throws an Error with the server's message, or after limitMs.
export function call(operation, argument = {}, limitMs = CALL_MS) {
  return post(`/call/${operation}`, argument, limitMs);
}

// Call an operation of the touch panel of a robot, for which its PIN is enough. The Error has the `status` of the answer.
export function callPanel(operation, robot, argument = {}, limitMs = CALL_MS) {
  return post(`/panel-call/${operation}/${encodeURIComponent(robot)}`, argument, limitMs);
}

// Do some work for a component; `busy` names its member that is true meanwhile, `problem` the one that says why it has
// failed, "" if it has not. Returns whether it has not.
export async function attempt(component, work, { busy = "isBusy", problem = "problem" } = {}) {
  component[busy] = true;
  component[problem] = "";
  try {
    await work();
    return true;
  } catch (error) {
    component[problem] = error.message;
    return false;
  } finally {
    component[busy] = false;
  }
}

async function post(address, argument, limitMs) {
  let answer;
  try {
    answer = await fetch(address, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(argument),
      signal: AbortSignal.timeout(limitMs),
    });
  } catch {
    throw new Error("the console does not answer");
  }
  const content = await answer.json().catch((error) => ({
    error: error.name === "TimeoutError" ? "the console does not answer" : `the console answers ${answer.status}`,
  }));
  if (content.error !== undefined) throw Object.assign(new Error(content.error), { status: answer.status });
  return content.answer;
}
