"""The exact model in the browser, for a page in which a reader sets the apparatus and sees its run at once.

`model.js` is written by `generate`: the driver and the models of `reference_ode.core` (`models`), as WebAssembly in base64.
`core.js` runs them as `core.host` does, so that a run has the same bits, and `run.js` gives it to the page.
"""
