// A name that floats in a 3D scene, of the same size at any distance.
import { THREE } from "nicegui-scene";
import { shortened } from "/static/texts.js";

const MAX_CHARACTERS = 22;
// Height of its picture, and on the screen [px].
const HEIGHT_PX = 40, SHOWN_PX = 20;

// color: of the plate. Names may be of any script; they are drawn, never interpreted.
export function textSprite(text, color = "#20262c") {
  const short = shortened(text, MAX_CHARACTERS);
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = "600 26px sans-serif";
  context.font = font;
  canvas.width = Math.ceil(context.measureText(short).width) + 24;
  canvas.height = HEIGHT_PX;
  context.font = font;
  context.fillStyle = color;
  context.globalAlpha = 0.82;
  context.beginPath();
  context.roundRect(0, 0, canvas.width, canvas.height, 9);
  context.fill();
  context.globalAlpha = 1;
  context.fillStyle = "#ffffff";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(short, canvas.width / 2, HEIGHT_PX / 2 + 1);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const always = { map, sizeAttenuation: false, depthTest: false, depthWrite: false };
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial(always));
  sprite.userData.shape = canvas.width / HEIGHT_PX;
  sprite.center.set(0.5, 0);
  sprite.renderOrder = 5;
  return sprite;
}

// pixel: the scale for one pixel, SceneView.spritePixel.
export function sizeSprite(sprite, pixel) {
  sprite.scale.set(SHOWN_PX * pixel * sprite.userData.shape, SHOWN_PX * pixel, 1);
}

export function closeSprite(sprite) {
  sprite.removeFromParent();
  sprite.material.map.dispose();
  sprite.material.dispose();
}
