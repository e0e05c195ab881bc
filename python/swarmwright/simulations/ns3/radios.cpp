// Radios of a swarm in ns-3, compiled by cppyy when it is first used: see __init__.py.

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "ns3/constant-position-mobility-model.h"
#include "ns3/double.h"
#include "ns3/mac48-address.h"
#include "ns3/mobility-helper.h"
#include "ns3/net-device-container.h"
#include "ns3/node-container.h"
#include "ns3/node.h"
#include "ns3/packet.h"
#include "ns3/propagation-delay-model.h"
#include "ns3/propagation-loss-model.h"
#include "ns3/random-variable-stream.h"
#include "ns3/rng-seed-manager.h"
#include "ns3/simulator.h"
#include "ns3/string.h"
#include "ns3/wifi-helper.h"
#include "ns3/wifi-mac-helper.h"
#include "ns3/yans-wifi-channel.h"
#include "ns3/yans-wifi-helper.h"

namespace swarmwright_radios {

constexpr uint16_t kProtocol = 0x88B5;     // for local experiments, IEEE 802
constexpr double kNearest = 0.01;          // metres, below which the loss does not change
constexpr double kLossAtOneMetre = 40.05;  // dB at 2.4 GHz in free space
constexpr uint32_t kHeader = 4;            // bytes, which hold the number of the message

struct Delivery {
  int receiver;
  uint32_t message;
  int64_t at;  // nanoseconds since the start
};

class Radios {
 public:
  Radios(int count, uint32_t seed, uint64_t run, const std::string& rate, double exponent, double power,
         double fading) {
    ns3::RngSeedManager::SetSeed(seed);
    ns3::RngSeedManager::SetRun(run);
    ns3::RngSeedManager::ResetNextStreamIndex();
    ns3::Mac48Address::ResetAllocationIndex();
    jitter_ = ns3::CreateObject<ns3::UniformRandomVariable>();
    nodes_.Create(count);
    ns3::MobilityHelper mobility;
    mobility.SetMobilityModel("ns3::ConstantPositionMobilityModel");
    mobility.Install(nodes_);
    auto loss = ns3::CreateObject<ns3::LogDistancePropagationLossModel>();
    loss->SetPathLossExponent(exponent);
    loss->SetReference(kNearest, kLossAtOneMetre + 10 * exponent * std::log10(kNearest));
    if (fading > 0) {
      auto nakagami = ns3::CreateObject<ns3::NakagamiPropagationLossModel>();
      for (const char* name : {"m0", "m1", "m2"}) {
        nakagami->SetAttribute(name, ns3::DoubleValue(fading));
      }
      loss->SetNext(nakagami);
    }
    auto channel = ns3::CreateObject<ns3::YansWifiChannel>();
    channel->SetPropagationLossModel(loss);
    channel->SetPropagationDelayModel(ns3::CreateObject<ns3::ConstantSpeedPropagationDelayModel>());
    ns3::YansWifiPhyHelper phy;
    phy.SetChannel(channel);
    phy.Set("TxPowerStart", ns3::DoubleValue(power));
    phy.Set("TxPowerEnd", ns3::DoubleValue(power));
    ns3::WifiMacHelper mac;
    mac.SetType("ns3::AdhocWifiMac");
    ns3::WifiHelper wifi;
    wifi.SetStandard(ns3::WIFI_STANDARD_80211b);
    wifi.SetRemoteStationManager("ns3::ConstantRateWifiManager", "DataMode", ns3::StringValue(rate), "NonUnicastMode",
                                 ns3::StringValue(rate));
    devices_ = wifi.Install(phy, mac, nodes_);
    for (int index = 0; index < count; ++index) {
      devices_.Get(index)->SetReceiveCallback(
          [this, index](ns3::Ptr<ns3::NetDevice>, ns3::Ptr<const ns3::Packet> packet, uint16_t, const ns3::Address&) {
            receive(index, packet);
            return true;
          });
    }
  }

  void move(int index, double x, double y, double z) {
    nodes_.Get(index)->GetObject<ns3::MobilityModel>()->SetPosition(ns3::Vector(x, y, z));
  }

  // Broadcasts a message of some bytes, at a random time of 0 to jitter seconds from now.
  void send(int index, uint32_t message, uint32_t bytes, double jitter) {
    uint8_t header[kHeader];
    for (uint32_t byte = 0; byte < kHeader; ++byte) {
      header[byte] = (message >> (8 * byte)) & 255;
    }
    auto packet = ns3::Create<ns3::Packet>(header, kHeader);
    packet->AddPaddingAtEnd(bytes > kHeader ? bytes - kHeader : 0);
    auto device = devices_.Get(index);
    auto wait = ns3::NanoSeconds(static_cast<int64_t>(1e9 * jitter_->GetValue(0, jitter)));
    ns3::Simulator::Schedule(
        wait, [device, packet]() { device->Send(packet, ns3::Mac48Address::GetBroadcast(), kProtocol); });
  }

  int64_t now() const { return ns3::Simulator::Now().GetNanoSeconds(); }

  std::vector<Delivery> run(int64_t nanoseconds) {
    ns3::Simulator::Stop(ns3::NanoSeconds(nanoseconds));
    ns3::Simulator::Run();
    std::vector<Delivery> deliveries;
    deliveries.swap(delivered_);
    return deliveries;
  }

  void close() {
    devices_ = ns3::NetDeviceContainer();
    nodes_ = ns3::NodeContainer();
    jitter_ = nullptr;
    ns3::Simulator::Destroy();
  }

 private:
  void receive(int index, ns3::Ptr<const ns3::Packet> packet) {
    uint8_t header[kHeader];
    packet->CopyData(header, kHeader);
    uint32_t message = 0;
    for (uint32_t byte = 0; byte < kHeader; ++byte) {
      message |= static_cast<uint32_t>(header[byte]) << (8 * byte);
    }
    delivered_.push_back({index, message, now()});
  }

  ns3::NodeContainer nodes_;
  ns3::NetDeviceContainer devices_;
  ns3::Ptr<ns3::UniformRandomVariable> jitter_;
  std::vector<Delivery> delivered_;
};

}  // namespace swarmwright_radios
