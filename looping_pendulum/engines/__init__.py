"""Physics engines that rebuild the apparatus, each behind one shape; `protocol` has the shape, `registry` the list."""
