package org.swarmwright;

/** The broker cannot be reached, or refuses the connection; the message says where and why. */
public class BrokerException extends RuntimeException {
  private static final long serialVersionUID = 1L;

  /** Says what went wrong. */
  public BrokerException(String message) {
    super(message);
  }

  /** Says what went wrong, with the cause. */
  public BrokerException(String message, Throwable cause) {
    super(message, cause);
  }
}
