"use strict";

// Elements that the page makes.

function make(name, parent, className, text) {
  const element = document.createElement(name);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

function makeButton(parent, className, text, onClick) {
  const button = make("button", parent, className, text);
  button.type = "button";
  button.addEventListener("click", onClick);
  return button;
}

// Turns what an element contains into a button in it.
function makeInnerButton(element, onClick) {
  const content = [...element.childNodes];
  const button = makeButton(element, "", "", onClick);
  button.append(...content);
  return button;
}

function makeSvg(parent, attributes) {
  parent.insertAdjacentHTML("beforeend", "<svg></svg>");
  setAttributes(parent.lastChild, attributes);
  return parent.lastChild;
}

function makeSvgElement(name, parent, attributes) {
  const element = document.createElementNS(parent.namespaceURI, name);
  setAttributes(element, attributes);
  parent.append(element);
  return element;
}

function setAttributes(element, attributes) {
  Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value));
}
