// Prints the bounds of the parameters that the live page fits, as JSON.
import { PARAMETERS } from "../../looping_pendulum/live/assets/trial/fit.js";

process.stdout.write(JSON.stringify(PARAMETERS));
