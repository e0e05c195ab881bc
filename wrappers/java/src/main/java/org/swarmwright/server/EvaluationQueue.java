package org.swarmwright.server;

import java.util.ArrayDeque;
import java.util.Deque;
import org.swarmwright.extension.MapReader;

/** Requests for offloaded evaluation of the tool that has the server. */
final class EvaluationQueue {
  private static final int MAX_WAITING = 4096;
  private static final long MAX_BYTES = 4L * MapReader.MAX_BLOCK;

  private String tool;
  private final Deque<Job> waiting = new ArrayDeque<>();
  private Job current;
  private long bytes;
  private boolean givenUp;

  EvaluationQueue(String tool, Job first) {
    this.tool = tool;
    current = first;
  }

  /** The tool that has the server; null after the work was given up, until a tool asks again. */
  String tool() {
    return tool;
  }

  /**
   * Returns whether the result of the job that has ended was given up, and is not to be sent, and
   * resets the mark, since the next job is a new request.
   */
  boolean takeGivenUp() {
    boolean wasGivenUp = givenUp;
    givenUp = false;
    return wasGivenUp;
  }

  /** Adds a request of a tool; after work was given up, it follows as soon as that has stopped. */
  void add(String asking, Job job) {
    tool = asking;
    bytes += job.size();
    waiting.add(job);
  }

  /** Removes and returns the next job, which is then under way; null if there is none. */
  Job next() {
    current = waiting.poll();
    if (current != null) {
      bytes -= current.size();
    }
    return current;
  }

  /** Gives up all jobs; the one that is being computed, as soon as it can be stopped. */
  void giveUp() {
    tool = null;
    givenUp = true;
    waiting.clear();
    bytes = 0;
    if (current != null) {
      current.abort();
    }
  }

  /** Why a request of a tool cannot be taken now; null if it can. */
  String reasonTaken(String other) {
    if (tool != null && !tool.equals(other)) {
      return "taken by " + tool;
    }
    return waiting.size() >= MAX_WAITING || bytes >= MAX_BYTES
        ? waiting.size() + " requests of this tool are waiting"
        : null;
  }
}
