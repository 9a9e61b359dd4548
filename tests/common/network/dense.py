"""The networks in the plain way: observations padded to one size, attention over all nodes under a mask.

It shares only the weights with the real networks: graphs, masks and attention are built anew from the observations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from common.network.decoders import DecoderLayer, Pointer
from common.network.encoder import Encoder
from common.network.policy_network import PolicyNetwork
from common.observations.observation import Observation, ObservationBatch
from learner.algorithm.critic import CriticHead

# Of what goes into a ReLU: at its kink rounding decides which of two gradients there is.
KINK = 1e-6


def watch_kinks(network: nn.Module) -> list[float]:
    """Return a list that receives how near to zero the inputs of each ReLU come in the next calls."""
    nearest: list[float] = []
    for name, module in network.named_modules():
        if name.endswith(".rise"):
            module.register_forward_hook(lambda _module, _inputs, result: nearest.append(result.abs().min().item()))
    return nearest


@dataclass
class DenseBatch:
    """Padded observations: features (k, n, F), attention mask (k, n, n), real nodes (k, n), and the choices."""

    features: Tensor
    mask: Tensor
    present: Tensor
    robots: list[int]
    beacons: list[list[int]]
    waypoints: list[list[int]]


def dense_batch(batch: ObservationBatch, features: Tensor, vanilla: bool) -> DenseBatch:
    """Pad a batch; ``features`` are those of all nodes behind one another."""
    observations = [batch[k] for k in range(len(batch))]
    size = max(observation.nodes for observation in observations)
    padded = torch.zeros(len(batch), size, features.shape[1])
    mask = torch.zeros(len(batch), size, size, dtype=torch.bool)
    present = torch.zeros(len(batch), size, dtype=torch.bool)
    first = 0
    for k, observation in enumerate(observations):
        padded[k, : observation.nodes] = features[first : first + observation.nodes]
        mask[k, : observation.nodes, : observation.nodes] = _adjacency(observation)
        present[k, : observation.nodes] = True
        first += observation.nodes
    beacons = [[o.robot] if vanilla else o.beacon_nodes().tolist() for o in observations]
    return DenseBatch(
        padded,
        mask,
        present,
        [o.robot for o in observations],
        beacons,
        [o.waypoint_nodes().tolist() for o in observations],
    )


def dense_policy(network: PolicyNetwork, batch: DenseBatch) -> tuple[Tensor, Tensor]:
    """Return log π_b of all beacons and log π_a of all pairs, in the order of `GraphBatch`."""
    nodes = _encode(network.encoder, batch)
    log_beacon, log_waypoint = [], []
    for k in range(len(batch.robots)):
        here = nodes[k, batch.present[k]]
        robot = here[batch.robots[k]][None]
        beacons, waypoints = here[batch.beacons[k]], here[batch.waypoints[k]]
        if network.beacon_decoder is None:
            log_beacon.append(torch.zeros(1))
            asking = robot
        else:
            asked = _decode(network.beacon_decoder.decoder, robot, here)
            log_beacon.append(_point(network.beacon_decoder.pointer, asked, beacons).log_softmax(1)[0])
            asking = torch.cat([beacons, robot.expand(len(beacons), -1)], dim=1)
        asked = _decode(network.waypoint_decoder.decoder, network.waypoint_decoder.join(asking), here)
        table = _point(network.waypoint_decoder.pointer, asked, waypoints).log_softmax(1)
        log_waypoint.append(table.flatten())
    return torch.cat(log_beacon), torch.cat(log_waypoint)


def dense_critic(encoder: Encoder, head: CriticHead, batch: DenseBatch) -> Tensor:
    """Return Q of all pairs, in the order of `GraphBatch`."""
    nodes = _encode(encoder, batch)
    values = []
    for k in range(len(batch.robots)):
        here = nodes[k, batch.present[k]]
        robot = here[batch.robots[k]][None]

        def decoded(ask: nn.Linear, rows: list[int], here: Tensor = here, robot: Tensor = robot) -> Tensor:
            asking = torch.cat([here[rows], robot.expand(len(rows), -1)], dim=1)
            return _decode(head.decoder, ask(asking), here)

        joined = head.join_waypoint(decoded(head.ask_waypoint, batch.waypoints[k]))[None]
        if head.ask_beacon is not None:
            joined = joined + head.join_beacon(decoded(head.ask_beacon, batch.beacons[k]))[:, None]
        values.append(head.value(joined.relu()).flatten())
    return torch.cat(values)


def _adjacency(observation: Observation) -> Tensor:
    mask = torch.eye(observation.nodes, dtype=torch.bool)
    lower = np.repeat(np.arange(observation.viewpoints), observation.degree)
    higher = observation.neighbours.astype(np.int64)
    mask[lower, higher] = True
    mask[higher, lower] = True
    for link in observation.target_links:
        mask[int(link), observation.viewpoints] = True
        mask[observation.viewpoints, int(link)] = True
    return mask


def _encode(encoder: Encoder, batch: DenseBatch) -> Tensor:
    nodes = encoder.embedding(batch.features)
    # A padded node sees itself, so that no row of the softmax is empty.
    mask = batch.mask | torch.eye(batch.mask.shape[1], dtype=torch.bool)
    for layer in encoder.layers:
        query, key, value = layer.attention.qkv(layer.attention_norm(nodes)).chunk(3, dim=-1)
        mixed = _attend(query, key, value, mask, layer.attention.heads)
        nodes = nodes + layer.attention.out(mixed)
        nodes = nodes + layer.feedforward(layer.feedforward_norm(nodes))
    return encoder.norm(nodes)


def _decode(decoder: DecoderLayer, queries: Tensor, nodes: Tensor) -> Tensor:
    attention = decoder.attention
    key, value = attention.kv(nodes)[None].chunk(2, dim=-1)
    mask = torch.ones(1, len(queries), len(nodes), dtype=torch.bool)
    mixed = _attend(attention.query(decoder.attention_norm(queries))[None], key, value, mask, attention.heads)
    queries = queries + attention.out(mixed[0])
    return decoder.norm(queries + decoder.feedforward(decoder.feedforward_norm(queries)))


def _attend(query: Tensor, key: Tensor, value: Tensor, mask: Tensor, heads: int) -> Tensor:
    def split(x: Tensor) -> Tensor:
        return x.unflatten(-1, (heads, -1)).transpose(1, 2)

    mixed = functional.scaled_dot_product_attention(split(query), split(key), split(value), mask[:, None])
    return mixed.transpose(1, 2).flatten(2)


def _point(pointer: Pointer, asked: Tensor, choices: Tensor) -> Tensor:
    queries, keys = pointer.query(asked), pointer.key(choices)
    return 10.0 * torch.tanh(queries @ keys.T / np.sqrt(queries.shape[1]))
