"""The scenarios, one module each; a module reads like its paper's section on the simulation."""
