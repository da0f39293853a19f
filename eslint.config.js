import js from "@eslint/js";

export default [
  js.configs.recommended,
  // Functions of one table take the same arguments, whether they read them or not
  { rules: { "no-unused-vars": ["error", { args: "none" }], eqeqeq: "error", "prefer-const": "error", "no-var": "error" } },
  { files: ["looping_pendulum/live/core.js"], languageOptions: { globals: { WebAssembly: "readonly", atob: "readonly" } } },
  {
    files: ["looping_pendulum/live/assets/**"],
    languageOptions: {
      globals: Object.fromEntries(
        ["window", "document", "location", "navigator", "self", "Worker", "Blob", "File", "URL", "URLSearchParams", "TextDecoder", "TextEncoder", "Option", "Theme",
          "IntersectionObserver", "ResizeObserver", "MediaRecorder", "Element", "Path2D", "performance", "requestAnimationFrame", "getComputedStyle",
          "setTimeout", "clearTimeout",
        ].map((name) => [name, "readonly"]),
      ),
    },
  },
];
