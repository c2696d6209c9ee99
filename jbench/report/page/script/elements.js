"use strict";

// Elements that the page makes.

function make(name, parent, kind, text) {
  const element = document.createElement(name);
  if (kind) element.className = kind;
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

function makeButton(parent, kind, text, act) {
  const button = make("button", parent, kind, text);
  button.type = "button";
  button.addEventListener("click", act);
  return button;
}

// Turns what an element contains into a button in it.
function makeInnerButton(element, act) {
  const content = [...element.childNodes];
  const button = makeButton(element, "", "", act);
  button.append(...content);
  return button;
}

function makeSvg(parent, attributes) {
  parent.insertAdjacentHTML("beforeend", "<svg></svg>");
  setAll(parent.lastChild, attributes);
  return parent.lastChild;
}

function makeMark(name, parent, attributes) {
  const element = document.createElementNS(parent.namespaceURI, name);
  setAll(element, attributes);
  parent.append(element);
  return element;
}

function setAll(element, attributes) {
  Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value));
}
