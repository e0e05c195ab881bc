package org.swarmwright.controllers;

/** A specification that cannot be used; names the field and says what would be right. */
public class SpecificationException extends IllegalArgumentException {
  private static final long serialVersionUID = 1L;

  SpecificationException(String field, String reason) {
    super("controller." + field + ": " + reason);
  }
}
