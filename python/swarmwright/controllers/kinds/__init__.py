"""Kinds of controllers, a module or folder each: options, genes and operators."""
