/** Who works here: the user, the groups that share, and after signing in the keys for programs. */

import { useState } from "preact/hooks";
import * as api from "../api/api";
import { base } from "../api/base";
import { bodyOf, client } from "../api/client";
import type { Schemas } from "../api/schemas";
import { ActionButton } from "../ui/dialogs";
import { ago, day } from "../ui/format";
import { notify } from "../ui/notices";

type Me = Schemas["MeOut"];
type Key = Schemas["ApiKey"];
type Member = Schemas["Member"];
const ROLES = ["owner", "editor", "viewer"] as const;
type Role = (typeof ROLES)[number];

/** The address without the group's part. */
const home = base.replace(/\/groups\/grp_[0-9a-z]+$/, "");

export interface Account {
  me: Me;
  /** Keys and browsers' sessions; null: the caller may not manage them. */
  keys: Key[] | null;
}

export async function readAccount(): Promise<Account> {
  const me = await bodyOf(client.GET("/v1/me"));
  const keys = me.session
    ? (await bodyOf(client.GET("/v1/keys"))).items.filter(({ owner }) => owner === me.user)
    : null;
  return { me, keys };
}

export function AccountPage(first: Account) {
  const [{ me, keys }, setAccount] = useState(first);
  const again = () => {
    readAccount().then(setAccount, notify);
  };
  return (
    <div class="account-page">
      <div class="latest-head">
        <h1>{me.name || "Account"}</h1>
        {me.session && <ActionButton label="Sign out" act={signOut} />}
      </div>
      <p class="hint">
        Your user id is <code>{me.user}</code>. Who shares a group with you needs it.
      </p>
      <Places me={me} />
      {me.groups.map(({ group, name, role }) => (
        <Members key={group} group={group} name={name} mayChange={role === "owner"} />
      ))}
      {keys ? (
        <Keys user={me.user} keys={keys} again={again} />
      ) : (
        <p>Sign in with a browser to make keys for programs.</p>
      )}
    </div>
  );
}

async function signOut(): Promise<void> {
  await api.request("/sign-out", { method: "POST" });
  location.assign(`${home}/`);
}

/** Where the user may work: alone, or in a group, whose members see everything there. */
function Places({ me }: { me: Me }) {
  return (
    <section>
      <h2>Work in</h2>
      <ul class="places">
        {[{ group: "", name: "Your own", role: "" }, ...me.groups].map(({ group, name, role }) => (
          <li key={group}>
            <a href={`${home}${group && `/groups/${group}`}/`} aria-current={me.owner === (group || me.user)}>
              {name}
            </a>
            {role && <small>{`as ${role}`}</small>}
          </li>
        ))}
      </ul>
    </section>
  );
}

function Members({ group, name, mayChange }: { group: string; name: string; mayChange: boolean }) {
  const [members, setMembers] = useState<Member[] | null>(null);
  const path = { group_id: group };
  const read = () =>
    bodyOf(client.GET("/v1/groups/{group_id}/members", { params: { path } })).then(
      ({ items }) => setMembers(items),
      notify,
    );
  const put = (user: string, role: Role) =>
    client.PUT("/v1/groups/{group_id}/members/{user_id}", {
      params: { path: { ...path, user_id: user } },
      body: { role },
    });
  const add = async (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    await put(String(new FormData(form).get("user")).trim(), "editor").then(() => form.reset(), notify);
    read();
  };
  return (
    <details class="members" onToggle={({ currentTarget }) => currentTarget.open && read()}>
      <summary>{`Members of ${name}`}</summary>
      <ul>
        {members?.map((one) => (
          <li key={one.user}>
            <span>{one.name}</span>
            {mayChange ? (
              <>
                <select
                  aria-label={`Role of ${one.name}`}
                  value={one.role}
                  onChange={({ currentTarget }) =>
                    put(one.user, currentTarget.value as Role)
                      .catch(notify)
                      .then(read)
                  }
                >
                  {ROLES.map((role) => (
                    <option key={role}>{role}</option>
                  ))}
                </select>
                <ActionButton
                  label="Remove"
                  act={() =>
                    client.DELETE("/v1/groups/{group_id}/members/{user_id}", {
                      params: { path: { ...path, user_id: one.user } },
                    })
                  }
                  done={read}
                />
              </>
            ) : (
              <small>{one.role}</small>
            )}
          </li>
        ))}
      </ul>
      {mayChange && (
        <form class="row" onSubmit={add}>
          <input
            type="text"
            name="user"
            required
            maxLength={100}
            placeholder="usr_…"
            aria-label={`User id of a new member of ${name}`}
          />
          <button class="button small" type="submit">
            Add
          </button>
        </form>
      )}
    </details>
  );
}

function Keys({ user, keys, again }: { user: string; keys: Key[]; again(): void }) {
  const [secret, setSecret] = useState("");
  const create = async (event: SubmitEvent) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement);
    const days = Number(form.get("days"));
    const body = {
      owner: user,
      name: String(form.get("name")).trim(),
      scopes: form.get("submit") ? (["read", "submit"] as const) : (["read"] as const),
      ...(days > 0 && { expires_at: Date.now() / 1000 + days * 86400 }),
    };
    await bodyOf(client.POST("/v1/keys", { body: { ...body, scopes: [...body.scopes] } })).then(
      (made) => setSecret(made.secret),
      notify,
    );
    again();
  };
  const rotate = async (id: string) =>
    setSecret((await bodyOf(client.POST("/v1/keys/{key_id}/rotate", { params: { path: { key_id: id } } }))).secret);
  return (
    <section>
      <h2>Keys for programs</h2>
      <form class="row" onSubmit={create}>
        <input
          type="text"
          name="name"
          required
          maxLength={100}
          placeholder="Name, such as Blender"
          aria-label="Name of the key"
        />
        <input name="days" type="number" min={1} max={3650} placeholder="Days" aria-label="Ends after so many days" />
        <label>
          <input type="checkbox" name="submit" checked /> may paint and change
        </label>
        <button class="button small" type="submit">
          Make a key
        </button>
      </form>
      {secret && (
        <p class="secret" role="status">
          Copy it now, it is not shown again: <code>{secret}</code>
        </p>
      )}
      <ul class="keys">
        {keys.map((key) => (
          <li key={key.id}>
            <div>
              <strong>{key.session ? "This or another browser" : key.name}</strong>
              <small>{facts(key)}</small>
            </div>
            {!key.revoked_at && (
              <div class="actions">
                {!key.session && <ActionButton label="Replace" act={() => rotate(key.id)} done={again} />}
                <ActionButton
                  label={key.session ? "Sign out" : "Revoke"}
                  danger
                  act={() => client.DELETE("/v1/keys/{key_id}", { params: { path: { key_id: key.id } } })}
                  done={again}
                />
              </div>
            )}
          </li>
        ))}
      </ul>
    </section>
  );
}

const facts = (key: Key): string =>
  [
    key.scopes.join(", "),
    `made ${day(key.created_at)}`,
    key.used_at ? `used ${ago(key.used_at)}` : "never used",
    key.expires_at && `ends ${day(key.expires_at)}`,
    key.revoked_at && `revoked ${day(key.revoked_at)}`,
  ]
    .filter(Boolean)
    .join(" · ");
