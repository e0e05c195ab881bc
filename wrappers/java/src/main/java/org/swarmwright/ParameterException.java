package org.swarmwright;

/** A parameter that cannot be used; says which, what was found and what is expected. */
public class ParameterException extends IllegalArgumentException {
  private static final long serialVersionUID = 1L;

  /** Names the parameter and says what is wrong with it. */
  public ParameterException(String name, String reason) {
    super("parameter " + name + ": " + reason);
  }
}
