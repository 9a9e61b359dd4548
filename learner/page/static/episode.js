// An episode on a map: what the actor knows, what it could go for, and what it chose.

import { colour, rgb } from "./core/dom.js";
import { disc, frontierCells, graph, legendItem, line, places, ring, triangle } from "./core/marks.js";

/** The belief's colours by state, as TilePicture.draw wants them. */
export const beliefColours = () => [rgb("unknown"), rgb("free"), rgb("occupied")];

/** Draw an episode into a context whose units are metres; pixel is the size of a pixel in metres. */
export function drawEpisode(context, pixel, picture, view, detailed = true) {
  picture.draw(context, beliefColours());
  if (!view) return;
  if (detailed) {
    graph(context, pixel, view);
    frontierCells(context, pixel, view);
  }
  const way = [...places(view.way, 2)];
  if (way.length > 1) line(context, way, colour("way"), (detailed ? 2.4 : 1.6) * pixel);
  const [waypoint] = places(view.waypoint, 2), [beacon] = places(view.beacon, 2), [target] = places(view.target, 2);
  const here = way.at(-1);
  if (waypoint && here) {
    context.setLineDash([6 * pixel, 4 * pixel]);
    line(context, [here, waypoint], colour("waypoint"), 2.4 * pixel);
    context.setLineDash([]);
    disc(context, ...waypoint.slice(0, 2), 5 * pixel, colour("waypoint"), colour("panel"), 1.5 * pixel);
  }
  for (const [x, y] of places(view.beacons, 2)) triangle(context, x, y, (detailed ? 8 : 5) * pixel, colour("beacon"), pixel);
  if (beacon) {
    triangle(context, beacon[0], beacon[1], 10 * pixel, colour("beacon"), pixel);
    ring(context, beacon[0], beacon[1], 15 * pixel, colour("beacon"), 2 * pixel);
  }
  if (target) {
    ring(context, target[0], target[1], (detailed ? 10 : 6) * pixel, colour("target"), 2.5 * pixel);
    disc(context, target[0], target[1], 3 * pixel, colour("target"));
  }
  if (way.length && !detailed) disc(context, way[0][0], way[0][1], 2.5 * pixel, colour("text"));
  if (here) disc(context, here[0], here[1], (detailed ? 8 : 4) * pixel, colour("robot"), colour("panel"), (detailed ? 2 : 1) * pixel);
}

/** The legend of what drawEpisode draws. */
export function episodeLegend() {
  return [
    legendItem("square", "free", "known free"), legendItem("square", "occupied", "wall"),
    legendItem("square", "frontier", "frontier"), legendItem("dot", "useful", "useful viewpoint"),
    legendItem("triangle", "beacon", "beacon, ringed: chosen"), legendItem("dashes", "waypoint", "next waypoint"),
    legendItem("line", "way", "driven way"), legendItem("dot", "robot", "robot"),
  ];
}
