/* Where the picture comes from: a file, what is dropped or pasted, or a text. */
import { attempt, byId, call, element, post } from "./api.js";
import { showWork } from "./survey.js";

const LARGEST_MB = 32;
let select = () => {};

function upload(blob, name) {
  if (blob.size > LARGEST_MB * 2 ** 20)
    return attempt("picture-error", Promise.reject(new Error(`${name} has more than ${LARGEST_MB} MB, too much for a picture. Scale it down; about 1000 pixels on a side are enough.`)));
  select("tab-preview");
  showWork(`Reading ${name} …`);
  return attempt("picture-error", call(`/api/pictures?name=${encodeURIComponent(name)}`, blob, "application/octet-stream").finally(() => showWork("")));
}

const uploadOne = async ([file]) => file && upload(file, file.name);

function useText() {
  attempt("picture-error", post("/api/text", { text: byId("text").value }).then(() => select("tab-preview")));
}

export function listenToPictures(selectTab) {
  select = selectTab;
  byId("file").addEventListener("change", async (e) => {
    await uploadOne(e.target.files);
    e.target.value = "";
  });
  // anywhere on the page: a picture that misses the field must not replace the page
  for (const kind of ["dragenter", "dragover", "dragleave", "drop"]) {
    document.addEventListener(kind, (e) => {
      e.preventDefault();
      byId("drop").classList.toggle("over", kind === "dragenter" || kind === "dragover");
      if (kind === "drop") uploadOne(e.dataTransfer.files);
    });
  }
  document.addEventListener("paste", (e) => uploadOne(e.clipboardData.files));
  byId("use-text").addEventListener("click", useText);
  byId("text").addEventListener("keydown", (e) => {
    if (e.key === "Enter") { e.preventDefault(); useText(); }
  });
}
