package org.swarmwright.server;

import static org.junit.jupiter.api.Assertions.assertArrayEquals;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.io.IOException;
import java.util.List;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.params.ParameterizedTest;
import org.junit.jupiter.params.provider.CsvSource;
import org.msgpack.value.Value;
import org.msgpack.value.ValueFactory;

/** What a server decides, without a broker: time is what the test says. */
class MachineTest extends MachineFixture {
  @Test
  void controlWaitsForItsParameters() {
    String mine = "'server': 7, 'simulation_hash': 'e'";
    say("control", mine);
    assertEquals(EarlyControls.MAX_WAIT_NANOS, machine.nextTick());
    now += SECOND / 2;
    machine.tick(now, "");
    assertEquals(0, sensors());
    say("parameters", mine);
    assertTrue(sensors() > 0);
    say("control", mine + ", 'run': false");
    assertTrue(isFree(""));
  }

  @Test
  void parametersThatTheSimulationDoesNotReadAreToldOnce() {
    String mine = "'server': 7, 'simulation_hash': 'e'";
    for (int i = 0; i < 2; i++) {
      say("parameters", mine + ", 'start': 3, 'strat': 4, 'seed': 5");
      say("control", mine);
      say("control", mine + ", 'run': false");
    }
    assertEquals(
        List.of(
            "warning: the parameter strat has no effect: the simulation does not read it; is it"
                + " misspelt?"),
        out.notices);
  }

  @Test
  void controlIsHeardOnTheOwnTopicAndOnThatOfAll() {
    String mine = "'server': 7, 'simulation_hash': 'e'";
    String own = "swarmwright/v1/server/7";
    say("parameters", mine);
    say("swarmwright/v1/server/8", mine);
    assertEquals(0, sensors());
    say(own, mine);
    assertTrue(sensors() > 0);
    say("control", mine + ", 'run': false");
    assertTrue(isFree(""));
    say("parameters", mine);
    say("control", mine);
    say(own, mine + ", 'run': false");
    assertTrue(isFree(""));
    assertEquals(List.of(), out.notices);
    say(own, "'server': 7");
    assertTrue(out.notices.toString().contains("\"simulation_hash\""));
  }

  @Test
  void controlWhoseParametersDoNotComeIsRefused() {
    String late = "'server': 7, 'simulation_hash': 'late'";
    String ended = "'server': 7, 'simulation_hash': 'ended'";
    say("control", late);
    now += SECOND;
    machine.tick(now, "");
    assertTrue(out.notices.toString().contains("no parameters arrived for its hash"));
    say("parameters", late);
    say("control", ended);
    say("control", ended + ", 'run': false");
    say("parameters", ended);
    assertEquals(0, sensors());
  }

  @Test
  void anotherToolsControlDoesNotEndAnEpisode() {
    String mine = "'server': 7, 'simulation_hash': 'e'";
    String end = mine + ", 'run': false";
    say("parameters", mine);
    say("control", mine + ", 'tool': 'ada'");
    say("control", end);
    say("control", end + ", 'tool': 'eve'");
    assertTrue(out.notices.toString().contains("ignoring the end of a run"));
    assertTrue(!isFree(", 'tool': 'ada'"), "under way");
    say("control", end + ", 'tool': 'ada'");
    assertTrue(isFree(""));
    // What waits for its parameters is its tool's, too.
    say("control", mine + ", 'tool': 'ada'");
    say("control", end + ", 'tool': 'eve'");
    say("parameters", mine);
    assertTrue(!isFree(""));
    say("control", end + ", 'tool': 'ada'");
    // A tool without a name ends its episode.
    say("parameters", mine);
    say("control", mine);
    say("control", end + ", 'tool': 'eve'");
    assertTrue(!isFree(""));
    say("control", end);
    assertTrue(isFree(""));
  }

  @Test
  void anEpisodeOfAnotherSimulationOrStartIsNotBegun() {
    String mine = "'server': 7, 'simulation_hash': 'e'";
    say("parameters", mine);
    say("control", mine + ", 'instance': 'another'");
    assertEquals(0, sensors());
    say("control", mine + ", 'simulation': 'tumble', 'reply': 'swarmwright/v1/tool/t'");
    assertEquals(0, sensors());
    assertEquals(1, out.replies.size());
    assertTrue(out.last("reason").toString().contains("not offered here, only walk"));
    assertEquals("true", out.last("invalid").toString());
    say("control", mine + ", 'instance': '" + identity.instance + "', 'simulation': 'walk'");
    assertTrue(sensors() > 0);
  }

  private void hearOf(String instance) {
    hearOf(instance, "ready");
  }

  private void hearOf(String instance, String state) {
    say(
        "swarmwright/v1/presence/7",
        "'version': 1, 'server': 7, 'state': '"
            + state
            + "', 'simulations': ['walk'], 'since': '',"
            + " 'capabilities': {'dimensions': 2, 'swarmwright': {'version': 1, 'host': 'far',"
            + " 'pid': 3, 'instance': '"
            + instance
            + "'}}");
  }

  @Test
  void ofTwoServersWithOneIdTheOneWithTheGreaterInstanceGoes() {
    machine.publishPresence("");
    hearOf(identity.instance);
    assertEquals(List.of(), out.rivals);
    assertEquals(1, out.published.size());
    // The other one is to go, and hears of this one.
    hearOf("z");
    assertEquals(List.of(), out.rivals);
    machine.tick(now, "");
    assertEquals(2, out.published.size());
    hearOf("!");
    assertEquals(List.of(), out.rivals, "that may be an old message");
    hearOf("!", "lost");
    now += SECOND;
    machine.tick(now, "");
    assertEquals(List.of(), out.rivals);
    hearOf("!");
    now += SECOND;
    machine.tick(now, "");
    assertEquals(List.of("far, process 3"), out.rivals);
  }

  @Test
  void candidatesAreEvaluatedInEveryEpisodeAndWhatFailsSaysWhy() throws IOException {
    evaluate(1, "ada", 0, 1, 13);
    work();
    assertArrayEquals(
        new double[] {0.5, Double.NaN, 1.0, Double.NaN}, doubles(out.last("fitness")));
    Value half = out.last("metrics").asMapValue().map().get(ValueFactory.newString("half"));
    assertArrayEquals(new double[] {0.25, Double.NaN, 0.5, Double.NaN}, doubles(half));
    assertEquals(2, out.last("failed").asArrayValue().size());
    String failed = out.last("failed").toString();
    assertTrue(failed.contains("UnsupportedOperationException: no thirteen"), failed);
    assertTrue(failed.contains("org.swarmwright.Walk.step"), failed);
    assertTrue(!failed.contains("swarmwright.server.Rollout"), failed);
  }

  @Test
  void requestsOfOneToolWaitAndOthersGetTaken() throws IOException {
    evaluate(1, "ada", 0, 1);
    evaluate(2, "ada", 0, 1);
    evaluate(3, "bob", 0, 1);
    assertTrue(out.error().contains("taken by ada"), out.error());
    assertEquals(1, out.jobs.size());
    work();
    work();
    assertEquals(3, out.replies.size());
    assertTrue(!isFree(", 'tool': 'bob'") && isFree(", 'tool': 'ada'"), "held for ada");
    now += 5 * SECOND;
    machine.tick(now, "2026-01-01T00:00:00Z");
    assertTrue(isFree(""));
  }

  @Test
  void aLeaseThatRanOutIsNotComputed() throws IOException {
    evaluate(1, "ada", 0, 1);
    evaluate(2, "ada", 3, 1);
    now += 4 * SECOND;
    work();
    assertTrue(out.error().contains("the lease ran out"), out.error());
    assertTrue(out.jobs.isEmpty());
  }

  @Test
  void whatIsGivenUpEndsSoonAndTheServerIsFree() throws IOException {
    evaluate(1, "ada", 0, 1);
    say("control", "'server': 7, 'simulation_hash': 'x', 'run': false, 'tool': 'ada'");
    assertTrue(!isFree(""), "still stopping");
    work();
    assertTrue(out.replies.isEmpty());
    assertTrue(isFree(""));
  }

  @Test
  void whatCannotBeServedIsInvalid() throws IOException {
    evaluate(1, "ada", 0, "speed", floats(0f, 1f), 1);
    assertTrue(out.error().contains("metrics: \\\"speed\\\" is not a metric of walk"), out.error());
    evaluate(2, "ada", 0, "half", floats(0f, 1f, 2f), 1);
    assertTrue(out.error().contains("genomes: 3 numbers"), out.error());
    evaluate(3, "ada", 0, "half", floats(0f, Float.NaN), 1);
    assertTrue(out.error().contains("\\\"genomes\\\"[1] is NaN"), out.error());
    assertTrue(out.error().contains("invalid"), out.error());
    assertTrue(isFree(""), "nothing of it takes the server");
  }

  @Test
  void aStepThatMissesActuatorsIsToldThenGivenUp() {
    say("parameters", "'server': 7, 'simulation_hash': 'h'");
    say("control", "'server': 7, 'simulation_hash': 'h'");
    assertEquals(
        "sensor {\"simulation\":\"walk\",\"simulation_hash\":\"h\",\"agent\":0,\"sensor\":[1]}",
        out.published.get(out.published.size() - 1));
    now += 5 * SECOND;
    machine.tick(now, "2026-01-01T00:00:00Z");
    assertTrue(out.notices.toString().contains("has not sent actuators for 1 of 1 agents (0)"));
    assertTrue(!isFree(""));
    now += 55 * SECOND;
    machine.tick(now, "2026-01-01T00:00:00Z");
    assertTrue(isFree(""));
  }

  @Test
  void aStepThatTakesLongerThanTheTimeoutIsNotGivenUp() {
    say("parameters", "'server': 7, 'simulation_hash': 'h'");
    say("control", "'server': 7, 'simulation_hash': 'h'");
    long turn = now;
    now += 120 * SECOND;
    machine.computed(turn, now);
    machine.tick(now, "2026-01-01T00:00:00Z");
    assertTrue(!out.notices.toString().contains("has not sent"), "the tool could not answer yet");
    assertTrue(!isFree(""));
    now += 60 * SECOND;
    machine.tick(now, "2026-01-01T00:00:00Z");
    assertTrue(isFree(""));
  }

  @Test
  void theFitnessHasTheMetrics() {
    say("parameters", "'server': 7, 'simulation_hash': 'h', 'start': 3");
    say("control", "'server': 7, 'simulation_hash': 'h'");
    say("actuator", "'simulation_hash': 'h', 'agent': 0, 'actuator': [5]");
    say("actuator", "'simulation_hash': 'h', 'agent': 0, 'actuator': [-0.5]");
    assertEquals(
        "fitness {\"simulation_hash\":\"h\",\"simulation\":\"walk\",\"fitness\":3.5,"
            + "\"metrics\":{\"half\":1.75}}",
        out.published.get(out.published.size() - 1));
    assertTrue(isFree(""));
  }

  @Test
  void aControlMessageThatComesTwiceBeginsNothing() {
    String control = ", 'tool': 'ada', 'reply': 'swarmwright/v1/tool/t'";
    startAndStep("h", "", control);
    int messages = out.published.size();
    say("control", "'server': 7, 'simulation_hash': 'h'" + control);
    assertEquals(messages, out.published.size());
    assertTrue(out.notices.toString().contains("starts a run a second time"));
  }

  @Test
  void aToolThatComesTooLateHearsOfIt() {
    say("parameters", "'server': 7, 'simulation_hash': 'h'");
    say("control", "'server': 7, 'simulation_hash': 'h', 'tool': 'ada'");
    now += SECOND;
    machine.tick(now, "2026-01-01T00:00:00Z");
    int messages = out.published.size();
    say("control", "'server': 7, 'simulation_hash': 'i', 'tool': 'bob'");
    now += SECOND;
    machine.tick(now, "2026-01-01T00:00:01Z");
    assertEquals(messages + 1, out.published.size());
  }

  @Test
  void anEpisodeThatFailsIsReportedAndTheNextOneIsSound() {
    String control = ", 'tool': 'ada', 'reply': 'swarmwright/v1/tool/t'";
    startAndStep("h", ", 'seed': 13", control);
    assertEquals("failed", out.last("kind").toString().replace("\"", ""));
    assertEquals("h", out.last("simulation_hash").toString().replace("\"", ""));
    String reason = out.last("reason").toString();
    assertTrue(
        reason.matches(".*UnsupportedOperationException: no thirteen \\(Walk.java:\\d+\\).*"),
        reason);
    String stack = out.last("stack").toString();
    assertTrue(stack.contains("org.swarmwright.Walk.step"), stack);
    assertTrue(!stack.contains("swarmwright.server."), stack);
    assertTrue(!isFree(", 'tool': 'bob'") && isFree(", 'tool': 'ada'"), "held for ada");
    startAndStep("i", ", 'seed': 1", control);
    assertTrue(out.published.get(out.published.size() - 1).startsWith("fitness "));
    assertEquals(1, out.replies.size());
  }

  @ParameterizedTest
  @CsvSource({
    "14, java.lang.Error: no fourteen",
    "15, java.io.IOException: no fifteen",
    "16, java.io.IOException: no sixteen",
    "17, 'metrics() gives 2 numbers, but the description has 1 names'"
  })
  void whateverIsWrongFailsTheEpisodeInEveryMode(long seed, String words) throws IOException {
    evaluate(1, "ada", 0, null, floats(0f, 0.25f), seed, 1);
    work();
    assertEquals("null", out.error());
    assertArrayEquals(new double[] {Double.NaN, 0.5}, doubles(out.last("fitness")));
    assertTrue(out.last("failed").toString().contains(words), out.last("failed").toString());
    startAndStep("h", ", 'seed': " + seed, ", 'tool': 'ada', 'reply': 'swarmwright/v1/tool/t'");
    assertTrue(out.last("reason").toString().contains(words), out.last("reason").toString());
    assertTrue(isFree(", 'tool': 'ada'"), "held for ada");
  }

  @Test
  void whatIsRefusedAtTheStartIsReportedToThoseWhoSayWhere() {
    startAndStep("h", ", 'start': 'far'", ", 'reply': 'swarmwright/v1/tool/t'");
    assertTrue(out.last("reason").toString().contains("parameter start"));
    assertEquals("true", out.last("invalid").toString());
    startAndStep("i", ", 'start': 'far'", ", 'reply': 'fitness'");
    startAndStep("j", ", 'seed': 13", "");
    assertEquals(1, out.replies.size());
    assertTrue(isFree(""));
  }

  @Test
  void whatTheBrokerDoesNotTakeEndsTheRunAndItsToolIsTold() {
    out.most = 60;
    say("parameters", "'server': 7, 'simulation_hash': 'h'");
    say(
        "control",
        "'server': 7, 'simulation_hash': 'h', 'tool': 'ada', 'reply': 'swarmwright/v1/tool/t'");
    assertEquals(
        "a sensor message of 66 bytes is larger than the 60 that the broker accepts",
        out.last("reason").toString());
    assertEquals("true", out.last("invalid").toString());
    out.most = Integer.MAX_VALUE;
    assertTrue(isFree(", 'tool': 'ada'"), "held for ada");
  }

  @Test
  void anAnswerThatTheBrokerDoesNotTakeBecomesARefusal() throws IOException {
    out.mostOfAnswers = 300;
    evaluate(1, "ada", 0, new long[40]);
    work();
    assertEquals(1, out.replies.size());
    assertTrue(out.error().contains("its answer of "), out.error());
    assertTrue(
        out.error().contains(" is larger than the 300 that the broker accepts"), out.error());
    out.mostOfAnswers = Integer.MAX_VALUE;
    evaluate(2, "ada", 0, 1);
    work();
    assertEquals("null", out.error());
  }

  @Test
  void aFailureThatTheBrokerDoesNotTakeIsToldWithoutItsStack() {
    String reply = ", 'tool': 'ada', 'reply': 'swarmwright/v1/tool/t'";
    out.mostOfAnswers = 250;
    startAndStep("h", ", 'seed': 13", reply);
    assertEquals(1, out.replies.size());
    assertTrue(out.last("reason").toString().contains("no thirteen"), out.replies.toString());
    assertEquals(null, out.last("stack"));
    assertTrue(isFree(", 'tool': 'ada'"), "held for ada");
    out.mostOfAnswers = 1;
    startAndStep("i", ", 'seed': 13", reply);
    assertEquals(1, out.replies.size());
    assertTrue(out.notices.toString().contains("larger than the 1 that the broker accepts"));
    assertTrue(isFree(", 'tool': 'ada'"), "held for ada");
  }

  @Test
  void aRefusalThatTheBrokerDoesNotTakeDoesNotStopTheQueue() throws IOException {
    evaluate(1, "ada", 0, 1);
    evaluate(2, "ada", 1, 1);
    evaluate(3, "ada", 0, 1);
    out.mostOfAnswers = 1;
    now += 2 * SECOND;
    work();
    assertEquals(List.of(), out.replies);
    out.mostOfAnswers = Integer.MAX_VALUE;
    work();
    assertEquals(1, out.replies.size());
    assertEquals("null", out.error());
    assertEquals("3", out.last("request").toString());
  }

  @Test
  void aParameterThatIsRefusedFreesTheServer() {
    say("parameters", "'server': 7, 'simulation_hash': 'h', 'start': 'far'");
    say("control", "'server': 7, 'simulation_hash': 'h'");
    assertTrue(
        out.notices.toString().contains("cannot start the run: parameter start: \"far\""),
        out.notices.toString());
    assertTrue(isFree(""));
  }

  @Test
  void presenceWaitsForTheConnectionToComeBack() {
    machine.publishPresence("2026-01-31T12:00:00Z");
    out.published.clear();
    machine.disconnected("gone", now);
    assertEquals(null, machine.nextTick());
    machine.tick(now + SECOND, "2026-01-31T12:00:01Z");
    assertEquals(List.of(), out.published, "a message would be lost");
    machine.connected("2026-01-31T12:00:02Z");
    assertEquals(List.of("presence"), out.published, "in the place of the last will");
  }
}
