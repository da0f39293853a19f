"""Adapters that build the apparatus in physics engines; `protocol` defines their interface, `registry` lists them."""
