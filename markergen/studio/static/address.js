/* A state as the fragment of an address, and back. */

export function written(state) {
  const bytes = new TextEncoder().encode(JSON.stringify(state));
  return `#${btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "")}`;
}

/* The state that a fragment holds; null if it holds none. */
export function read(fragment) {
  if (fragment.length < 2) return null;
  try {
    const bytes = Uint8Array.from(atob(fragment.slice(1).replaceAll("-", "+").replaceAll("_", "/")), (each) => each.charCodeAt(0));
    const state = JSON.parse(new TextDecoder().decode(bytes));
    return state && typeof state === "object" && !Array.isArray(state) ? state : null;
  } catch {
    return null;
  }
}
