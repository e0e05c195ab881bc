package org.swarmwright.messages;

/** A payload is not a valid message of this protocol; the message says why. */
public class MessageException extends IllegalArgumentException {
  private static final long serialVersionUID = 1L;

  /** Says what is wrong. */
  public MessageException(String reason) {
    super(reason);
  }
}
