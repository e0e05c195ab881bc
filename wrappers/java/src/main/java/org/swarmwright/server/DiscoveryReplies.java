package org.swarmwright.server;

import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Discovery;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Requirements;
import org.swarmwright.messages.Server;
import org.swarmwright.messages.Topics.Topic;

/** Answers discovery messages. */
final class DiscoveryReplies {
  private final Identity identity;
  private final Offer offer;
  private final Outbox outbox;

  DiscoveryReplies(Identity identity, Offer offer, Outbox outbox) {
    this.identity = identity;
    this.offer = offer;
    this.outbox = outbox;
  }

  /** Whether the simulation that is asked for is offered, and fulfils the requirements. */
  boolean fulfils(Discovery discovery) {
    if (!offer.offers(discovery.getSimulation())) {
      return false;
    }
    Capabilities capabilities = identity.capabilities(offer);
    Requirements required = discovery.getRequirements();
    boolean enoughAgents =
        capabilities.getMaxAgents() == null
            || required.getMaxAgents() == null
            || capabilities.getMaxAgents() >= required.getMaxAgents();
    return enoughAgents && required.getDimensions().equals(capabilities.getDimensions());
  }

  /** Tells the tool that it may have the server. */
  void send(Discovery discovery) {
    Server reply =
        new Server()
            .withServer(identity.id)
            .withSimulationHash(discovery.getSimulationHash())
            .withSimulations(offer.titles())
            .withCapabilities(identity.capabilities(offer));
    outbox.publish(Topic.SERVER, Messages.write(reply));
  }
}
