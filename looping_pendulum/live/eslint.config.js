import js from "@eslint/js";

export default [
  js.configs.recommended,
  // Functions of one table take the same arguments, whether they read them or not
  { rules: { "no-unused-vars": ["error", { args: "none" }], eqeqeq: "error", "prefer-const": "error", "no-var": "error" } },
];
