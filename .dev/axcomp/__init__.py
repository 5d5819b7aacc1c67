"""Turn measurements of a machine tool into compensation lists that are proven to work.

Three parts, imported by their own names so that a command which only reads lists never
pays for what only a fit needs:

* `axcomp.models`: what the controller does with a list, differentiable (JAX).
* `axcomp.data`: what was measured, and what a list says (no JAX).
* `axcomp.ident`: from measurement to list: fits, proofs, reports, jobs, command line.
"""

__version__ = "0.1.0"
