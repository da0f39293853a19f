"""The exact model in plain JavaScript, for a page in which a reader sets the apparatus and sees its run at once.

`model.js` is written by `generate` from `reference_ode`, so that no equation stands twice; the method of integration, the
search for events and the loop over the modes (`integrator.js`, `events.js`, `run.js`) follow `scipy_backend` and `driver`.
"""
